// SPDX-License-Identifier: Apache-2.0
#include "server/engine/engine_options.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

struct AtLeast {
  const char* name;
  int64_t value;
  int64_t lowest;
};

}  // namespace

absl::Status EngineOptions::Validate() const {
  for (const AtLeast& field :
       {AtLeast{"compute_threads", compute_threads, 0},
        {"decode_threads", decode_threads, 1},
        {"hop_frames", hop_frames, 1},
        {"iterations", iterations, 1},
        {"max_sessions", max_sessions, 1},
        {"max_batch_rows", max_batch_rows, 1},
        {"max_batch_frames", max_batch_frames, 1},
        {"max_pending_frames", max_pending_frames, 1},
        {"cache_budget_bytes", cache_budget_bytes, 1},
        {"max_processing_pixels", max_processing_pixels, int64_t{kProcessingSizeStep} * kProcessingSizeStep},
        {"max_iterations", max_iterations, iterations},
        {"limits.max_points", limits.max_points, 1},
        {"limits.max_frame_bytes", limits.max_frame_bytes, 1},
        {"limits.max_frame_pixels", limits.max_frame_pixels, 1},
        {"limits.max_frames", limits.max_frames, 0}}) {
    if (field.value >= field.lowest) continue;
    return absl::InvalidArgumentError(
        absl::StrCat(field.name, " is ", field.value, ", must be at least ", field.lowest));
  }
  for (const auto& [name, value] : {std::pair{"max_load", max_load},
                                    {"least_frames_per_second", least_frames_per_second},
                                    {"least_step", least_step}}) {
    if (std::isfinite(value) && value >= 0) continue;
    return absl::InvalidArgumentError(absl::StrCat(name, " is ", value, ", must be at least 0"));
  }
  if (!IsProcessingSize(processing_size) || Pixels(processing_size) > max_processing_pixels) {
    return absl::InvalidArgumentError(absl::StrCat("processing_size is ", ToString(processing_size),
                                                   ", must be multiples of ", kProcessingSizeStep, " and at most ",
                                                   max_processing_pixels, " pixels"));
  }
  return absl::OkStatus();
}

}  // namespace holdfast
