// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/types.h"
#include "client/cli/latencies.h"

namespace holdfast {

// How long each frame waited for its first estimate. Frames before the first point do not wait. Thread-safe.
class AnswerTimes {
 public:
  explicit AnswerTimes(std::function<SteadyTime()> now) : now_(std::move(now)) {}

  // The next frame is being sent.
  void Sent() ABSL_LOCKS_EXCLUDED(mutex_);
  // Frames up to the newest that has an estimate.
  int64_t Answered(const TrackUpdate& update) ABSL_LOCKS_EXCLUDED(mutex_);
  int64_t answered() const ABSL_LOCKS_EXCLUDED(mutex_);
  // One line; empty before the first answer.
  std::string Summary() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  const std::function<SteadyTime()> now_;
  mutable absl::Mutex mutex_;
  std::vector<SteadyTime> sent_ ABSL_GUARDED_BY(mutex_);
  int64_t answered_ ABSL_GUARDED_BY(mutex_) = 0;  // frames up to the newest that has an estimate
  Latencies waited_ ABSL_GUARDED_BY(mutex_);      // of those of them that were not there before their first estimate
};

}  // namespace holdfast
