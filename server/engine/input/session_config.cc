// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/session_config.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "server/engine/input/frame_decoder.h"
#include "server/engine/input/object_input.h"
#include "server/engine/input/point_check.h"

namespace holdfast {
namespace {

constexpr double kMaxFramesPerSecond = 1000;

void CheckRawSize(const SessionConfig& config, const EngineOptions& options, Violations& violations) {
  const ImageSize size = config.raw_size;
  if (!IsRaw(config.encoding)) {
    if (!size.empty())
      violations.Add("config.raw_size", absl::StrCat("is ", ToString(size), ", but only raw encodings have one"));
  } else if (size.width <= 0 || size.height <= 0) {
    violations.Add("config.raw_size",
                   absl::StrCat("is ", ToString(size), ", but raw encodings need the size of the frames"));
  } else if (Pixels(size) > options.limits.max_frame_pixels) {
    violations.Add("config.raw_size",
                   absl::StrCat(ToString(size), " is more than ", options.limits.max_frame_pixels, " pixels"));
  } else if (RawBytes(config.encoding, size) > options.limits.max_frame_bytes) {
    violations.Add("config.raw_size", absl::StrCat(ToString(size), " makes frames of ", RawBytes(config.encoding, size),
                                                   " bytes, at most ", options.limits.max_frame_bytes, " are taken"));
  }
}

void CheckProcessingSize(ImageSize size, const EngineOptions& options, Violations& violations) {
  if (!IsProcessingSize(size)) {
    violations.Add("config.processing_size",
                   absl::StrCat(ToString(size), " is not made of multiples of ", kProcessingSizeStep));
  } else if (Pixels(size) > options.max_processing_pixels) {
    violations.Add("config.processing_size",
                   absl::StrCat(ToString(size), " is more than ", options.max_processing_pixels, " pixels"));
  }
}

// The least hop that a session may have. The published chaining has only one.
int LeastHop(const SessionConfig& config, const EngineOptions& options, int window) {
  if (config.hop_frames != 0) return config.hop_frames;
  if (options.chaining == Chaining::kPublished) return window - 1;
  return config.max_hop_frames > 0 ? std::min(options.hop_frames, config.max_hop_frames) : options.hop_frames;
}

// What a resumed session has to be sent again changes when windows end: checkpoints in between would cost much, 4 kB a
// point, and save nothing.
int CheckpointInterval(int wanted, int hop_frames) { return wanted > 0 ? std::max(wanted, hop_frames) : wanted; }

// Frames that are squeezed to a third of their height turn another way than they do: a default stands as they do.
ImageSize ProcessingSize(const SessionConfig& config, const EngineOptions& options) {
  if (!config.processing_size.empty()) return config.processing_size;
  return TurnedLike(options.processing_size, config.raw_size.empty() ? config.frame_size : config.raw_size);
}

bool Switch(const std::optional<bool>& wanted, bool standard, const EngineOptions& options) {
  return wanted.value_or(standard && options.chaining != Chaining::kPublished);
}

void CheckMotion(const SessionConfig& config, const SessionAccepted& accepted, const EngineOptions& options,
                 Violations& violations) {
  const bool published = options.chaining == Chaining::kPublished;
  if (published && accepted.motion_prior) {
    violations.Add("config.motion_prior", "the server's chaining of windows has none");
  }
  if (published && accepted.polish) violations.Add("config.polish", "the server's chaining of windows has none");
  if (accepted.emit == Emit::kEveryFrame && !config.send_provisional) {
    violations.Add("config.emit", "estimates of every frame are provisional; do not ask for final ones only");
  }
}

void CheckHops(const SessionConfig& config, const SessionAccepted& accepted, const EngineOptions& options,
               Violations& violations) {
  const int lowest = options.chaining == Chaining::kPublished ? accepted.window_frames - 1 : 1;
  const int highest = accepted.window_frames - 1;
  if (accepted.hop_frames < lowest || accepted.hop_frames > highest) {
    violations.Add("config.hop_frames", absl::StrCat(accepted.hop_frames, " is not in ", lowest, " .. ", highest));
  } else if (const int most = config.max_hop_frames; most != 0 && (most < accepted.hop_frames || most > highest)) {
    violations.Add("config.max_hop_frames",
                   absl::StrCat(most, " is not in ", accepted.hop_frames, " .. ", highest, ", from hop_frames on"));
  }
}

void CheckNumbers(const SessionAccepted& accepted, const EngineOptions& options, Violations& violations) {
  if (accepted.checkpoint_interval_frames < 0) {
    violations.Add("config.checkpoint_interval_frames",
                   absl::StrCat("is ", accepted.checkpoint_interval_frames, ", expected 0 or more"));
  }
  if (accepted.iterations < 1 || accepted.iterations > options.max_iterations) {
    violations.Add("config.iterations", absl::StrCat(accepted.iterations, " is not in 1 .. ", options.max_iterations));
  }
}

void CheckPromise(const SessionConfig& config, const SessionLimits& limits, Violations& violations) {
  if (!(config.frames_per_second >= 0 && config.frames_per_second <= kMaxFramesPerSecond)) {  // nor is NaN
    violations.Add("config.frames_per_second",
                   absl::StrCat("is ", config.frames_per_second, ", expected 0 .. ", kMaxFramesPerSecond));
  }
  if (config.expected_points < 0 || config.expected_points > limits.max_points) {
    violations.Add("config.expected_points",
                   absl::StrCat("is ", config.expected_points, ", expected 0 .. ", limits.max_points));
  }
}

}  // namespace

absl::StatusOr<SessionAccepted> Negotiate(const SessionConfig& config, const EngineOptions& options,
                                          const ModelInfo& model) {
  SessionAccepted accepted;
  accepted.limits = options.limits;
  if (config.max_points > 0) accepted.limits.max_points = std::min(config.max_points, options.limits.max_points);
  const int64_t count = static_cast<int64_t>(config.points.size()) + PointsOf(config.objects);
  if (absl::Status status = CheckPointCount(count, accepted.limits.max_points); !status.ok()) return status;
  accepted.processing_size = ProcessingSize(config, options);
  accepted.window_frames = model.window_frames;
  accepted.iterations = config.iterations == 0 ? options.iterations : config.iterations;
  accepted.emit = config.emit;
  accepted.motion_prior = Switch(config.motion_prior, options.motion_prior, options);
  accepted.polish = Switch(config.polish, options.polish, options);
  accepted = WithHop(std::move(accepted), config, LeastHop(config, options, model.window_frames));
  Violations violations;
  CheckRawSize(config, options, violations);
  CheckProcessingSize(accepted.processing_size, options, violations);
  CheckHops(config, accepted, options, violations);
  CheckNumbers(accepted, options, violations);
  CheckMotion(config, accepted, options, violations);
  CheckPromise(config, accepted.limits, violations);
  if (config.label.size() > kMaxLabelBytes) {
    violations.Add("config.label",
                   absl::StrCat("has ", config.label.size(), " bytes, expected at most ", kMaxLabelBytes));
  }
  std::optional<ImageSize> frame;
  if (IsRaw(config.encoding) && config.raw_size.width > 0 && config.raw_size.height > 0) frame = config.raw_size;
  violations.Append(CheckPoints("config.points", config.points, frame));
  violations.Append(CheckObjects("config.objects", config.objects, frame));
  if (!violations.empty()) return violations.ToStatus();
  return accepted;
}

SessionAccepted WithHop(SessionAccepted accepted, const SessionConfig& config, int hop_frames) {
  accepted.hop_frames = hop_frames;
  accepted.checkpoint_interval_frames = CheckpointInterval(config.checkpoint_interval_frames, hop_frames);
  return accepted;
}

}  // namespace holdfast
