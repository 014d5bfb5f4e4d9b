// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "server/engine/metrics.h"

namespace holdfast {

// Tells the metrics, once a frame, how long after its arrival the first estimate and the last final one of its points
// came. Frames without any point count for nothing. Thread-safe.
class LatencyLog {
 public:
  explicit LatencyLog(EngineMetrics& metrics) : metrics_(metrics) {}
  // The first frame to arrive; frames before 'estimated_before' had their first estimate already.
  void StartAt(int64_t frame, int64_t estimated_before) ABSL_LOCKS_EXCLUDED(mutex_);
  // Of the next frame.
  void Arrived(SteadyTime when) ABSL_LOCKS_EXCLUDED(mutex_);
  // Frames first .. before - 1 have an estimate.
  void Estimated(int64_t first, int64_t before, SteadyTime now) ABSL_LOCKS_EXCLUDED(mutex_);
  // Frames before 'before' are final for every point.
  void Final(int64_t before, SteadyTime now) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  EngineMetrics& metrics_;
  absl::Mutex mutex_;
  std::deque<SteadyTime> arrivals_ ABSL_GUARDED_BY(mutex_);  // from frame final_before_ on
  int64_t estimated_before_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t final_before_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace holdfast
