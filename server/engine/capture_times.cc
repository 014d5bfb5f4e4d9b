// SPDX-License-Identifier: Apache-2.0
#include "server/engine/capture_times.h"

#include <algorithm>

namespace holdfast {

void CaptureTimes::StartAt(int64_t frame) {
  absl::MutexLock lock(&mutex_);
  oldest_ = frame;
}

void CaptureTimes::Push(std::optional<absl::Time> time) {
  absl::MutexLock lock(&mutex_);
  known_ += time ? 1 : 0;
  times_.push_back(time);
}

void CaptureTimes::EvictBefore(int64_t frame) {
  absl::MutexLock lock(&mutex_);
  for (; oldest_ < frame && !times_.empty(); ++oldest_) {
    known_ -= times_.front() ? 1 : 0;
    times_.pop_front();
  }
}

std::vector<FrameTime> CaptureTimes::Of(absl::Span<const PointRun> runs) const {
  absl::MutexLock lock(&mutex_);
  if (known_ == 0) return {};
  std::vector<bool> wanted(times_.size());
  for (const PointRun& run : runs) {
    const auto begin = std::max<int64_t>(run.first_frame - oldest_, 0);
    const auto end =
        std::min(run.first_frame + static_cast<int64_t>(run.x.size()) - oldest_, static_cast<int64_t>(times_.size()));
    if (begin < end) std::fill(wanted.begin() + begin, wanted.begin() + end, true);
  }
  std::vector<FrameTime> found;
  for (size_t i = 0; i < times_.size(); ++i) {
    if (wanted[i] && times_[i]) found.push_back({oldest_ + static_cast<int64_t>(i), *times_[i]});
  }
  return found;
}

}  // namespace holdfast
