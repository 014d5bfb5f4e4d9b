// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

#include "server/engine/tracker_model.h"

namespace holdfast {

// The features of consecutive frames of one session, each made once. Not thread-safe.
class FeatureCache {
 public:
  // The first frame to come. REQUIRES: the cache is empty.
  void StartAt(int64_t frame) { oldest_ = frame; }
  // Of the frame after the newest.
  void Push(FrameFeaturesPtr features);
  // REQUIRES: oldest() <= frame <= newest().
  const FrameFeaturesPtr& At(int64_t frame) const { return frames_[frame - oldest_]; }
  void EvictBefore(int64_t frame);
  void Clear() { EvictBefore(newest() + 1); }

  int64_t oldest() const { return oldest_; }
  int64_t newest() const { return oldest_ + size() - 1; }  // the one before the first frame, before that came
  int64_t size() const { return static_cast<int64_t>(frames_.size()); }
  int64_t bytes() const { return bytes_; }

 private:
  std::deque<FrameFeaturesPtr> frames_;
  int64_t oldest_ = 0;
  int64_t bytes_ = 0;
};

}  // namespace holdfast
