// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "absl/container/flat_hash_map.h"
#include "api/types.h"

namespace holdfast {

// Takes from the updates of a session that was resumed what was reported before: no final sample comes twice, no
// provisional one after the final one of its frame, and watermarks never fall. Relies on a point's frames becoming
// final in order, and each once: an id that is added anew starts behind its old track. (One that was removed and added
// again at the very same frame does not: should the session be lost just between the final samples that its two tracks
// have there, the second is taken for the first.) Not thread-safe.
class FinalFilter {
 public:
  // What was reported so far may come again from now on.
  void Resume() {
    repeated_ = reported_;
    repeated_objects_ = reported_objects_;
  }
  void Apply(TrackUpdate& update);
  // No sample of a frame before this one comes again. What has to be remembered is bounded by it.
  void ForgetBefore(int64_t frame);

  int64_t frames_processed() const { return frames_processed_; }
  size_t points_remembered() const { return reported_.size(); }

 private:
  using FramesByPoint = absl::flat_hash_map<PointId, int64_t>;  // frames before this one are final
  using FramesByObject = absl::flat_hash_map<ObjectId, int64_t>;

  FramesByPoint reported_;
  FramesByPoint repeated_;  // as of the last Resume: only what comes again is cut
  FramesByObject reported_objects_;
  FramesByObject repeated_objects_;
  int64_t frames_received_ = 0;
  int64_t frames_processed_ = 0;
};

}  // namespace holdfast
