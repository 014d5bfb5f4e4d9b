// SPDX-License-Identifier: Apache-2.0
#include "server/engine/engine_options.h"

#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// More than anybody has: products of such numbers fit into 64 bits.
constexpr int64_t kMany = int64_t{1} << 16;
constexpr int64_t kHuge = int64_t{1} << 50;

struct Range {
  const char* name;
  int64_t value;
  int64_t lowest, highest;
};

}  // namespace

absl::Status EngineOptions::Validate() const {
  for (const Range& field :
       {Range{"compute_threads", compute_threads, 0, kMany},
        {"decode_threads", decode_threads, 1, kMany},
        {"hop_frames", hop_frames, 1, kMany},
        {"max_iterations", max_iterations, 1, kMany},
        {"iterations", iterations, 1, max_iterations},
        {"max_sessions", max_sessions, 1, kMany},
        {"max_batch_rows", max_batch_rows, 1, kMany},
        {"max_batch_frames", max_batch_frames, 1, kMany},
        {"max_pending_frames", max_pending_frames, 1, kMany},
        {"cache_budget_bytes", cache_budget_bytes, 1, kHuge},
        {"max_processing_pixels", max_processing_pixels, int64_t{kProcessingSizeStep} * kProcessingSizeStep, kHuge},
        {"limits.max_points", limits.max_points, 1, kHuge},
        {"limits.max_frame_bytes", limits.max_frame_bytes, 1, kHuge},
        {"limits.max_frame_pixels", limits.max_frame_pixels, 1, kHuge},
        {"limits.max_frames", limits.max_frames, 0, std::numeric_limits<int64_t>::max()}}) {
    if (field.value >= field.lowest && field.value <= field.highest) continue;
    return absl::InvalidArgumentError(
        absl::StrCat(field.name, " is ", field.value, ", expected ", field.lowest, " .. ", field.highest));
  }
  for (const auto& [name, value] : {std::pair{"max_load", max_load},
                                    {"least_frames_per_second", least_frames_per_second},
                                    {"least_step", least_step}}) {
    if (std::isfinite(value) && value >= 0) continue;
    return absl::InvalidArgumentError(absl::StrCat(name, " is ", value, ", expected 0 or more"));
  }
  if (!IsProcessingSize(processing_size) || Pixels(processing_size) > max_processing_pixels) {
    return absl::InvalidArgumentError(absl::StrCat("processing_size is ", ToString(processing_size),
                                                   ", must be multiples of ", kProcessingSizeStep, " and at most ",
                                                   max_processing_pixels, " pixels"));
  }
  return absl::OkStatus();
}

}  // namespace holdfast
