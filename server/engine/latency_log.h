// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

#include "proto/clock.h"
#include "server/engine/metrics.h"

namespace holdfast {

// Tells the metrics, once a frame, how long after its arrival the first estimate and the last final one of its points
// came. Frames without any point count for nothing. Not thread-safe.
class LatencyLog {
 public:
  explicit LatencyLog(EngineMetrics& metrics) : metrics_(metrics) {}
  // Of the next frame.
  void Arrived(SteadyTime when) { arrivals_.push_back(when); }
  // Frames first .. before - 1 have an estimate.
  void Estimated(int64_t first, int64_t before, SteadyTime now);
  // Frames before 'before' are final for every point.
  void Final(int64_t before, SteadyTime now);

 private:
  EngineMetrics& metrics_;
  std::deque<SteadyTime> arrivals_;  // from frame final_before_ on
  int64_t estimated_before_ = 0;
  int64_t final_before_ = 0;
};

}  // namespace holdfast
