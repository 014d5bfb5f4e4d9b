// SPDX-License-Identifier: Apache-2.0
#include "server/engine/latency_log.h"

#include <algorithm>

namespace holdfast {

void LatencyLog::StartAt(int64_t frame, int64_t estimated_before) {
  absl::MutexLock lock(&mutex_);
  final_before_ = frame;
  estimated_before_ = estimated_before;
}

void LatencyLog::Arrived(SteadyTime when) {
  absl::MutexLock lock(&mutex_);
  arrivals_.push_back(when);
}

void LatencyLog::Estimated(int64_t first, int64_t before, SteadyTime now) {
  absl::MutexLock lock(&mutex_);
  for (int64_t frame = std::max({first, estimated_before_, final_before_}); frame < before; ++frame) {
    metrics_.FirstEstimate(Between(arrivals_[frame - final_before_], now));
  }
  estimated_before_ = std::max(estimated_before_, before);
}

void LatencyLog::Final(int64_t before, SteadyTime now) {
  absl::MutexLock lock(&mutex_);
  for (; final_before_ < before; ++final_before_) {
    if (final_before_ < estimated_before_) metrics_.FinalEstimate(Between(arrivals_.front(), now));
    arrivals_.pop_front();
  }
}

}  // namespace holdfast
