// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "api/point_tracker.h"
#include "training/evaluation/clip_tracker.h"

namespace holdfast {

struct StreamClipTrackerOptions {
  std::string name;           // of the method, for reports
  ImageSize processing_size;  // as in SessionConfig; empty: the tracker's default
  int hop_frames = 0;         // as in SessionConfig
  int iterations = 0;         // as in SessionConfig
  // Says how many iterations a window of a point took since it was asked before, their mean. Empty: nobody knows.
  std::function<std::optional<double>()> iterations_taken;
};

// Evaluates what users get: each clip is one session of a PointTracker, fed with raw frames of the clip's own size and
// every point in the frame of its query. Only final estimates are taken; a session that ends without one of them is an
// error.
class StreamClipTracker final : public ClipTracker {
 public:
  // 'tracker' must outlive this.
  StreamClipTracker(PointTracker& tracker, StreamClipTrackerOptions options);

  std::string name() const override { return options_.name; }
  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) override;

 private:
  PointTracker& tracker_;
  const StreamClipTrackerOptions options_;
};

}  // namespace holdfast
