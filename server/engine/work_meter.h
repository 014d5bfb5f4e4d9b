// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/metrics.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// How much work the compute thread has time for. Work is counted in point-frames: one point followed through one frame
// with the default hop and number of iterations. What that takes is measured when the network is warmed up, and how
// much slower (or faster) than then the machine is, is learnt from every batch: a neighbour that comes, optical flow on
// the same cores and a processor that throttles all make the budget smaller. Thread-safe.
class WorkMeter {
 public:
  struct Options {
    WorkCosts costs;
    int hop_frames = 1;  // defaults of sessions
    int iterations = 1;
    double max_load = 1;  // share of the thread's time that may be promised; 0: any
  };
  // Of a session, in point-frames.
  struct FrameWork {
    double frame = 0;  // a frame itself, whatever its points
    double point = 0;  // a point on a frame
  };
  // Both must outlive the meter.
  WorkMeter(const Options& options, const Clock& clock, EngineMetrics& metrics);

  FrameWork Of(const SessionAccepted& session) const;
  // Point-frames a second; infinite where nothing is known or nothing bounds it.
  double Budget() const ABSL_LOCKS_EXCLUDED(mutex_);
  // The budget of a machine that is as quiet as it was at warm-up.
  double QuietBudget() const;

  // What a batch took.
  void Encoded(int64_t pixels, absl::Duration took);
  // 'iterations': as many as a row may take. Rows that end early make the machine look faster, and so they should.
  void Refined(int64_t rows, int iterations, absl::Duration took);

 private:
  void Add(double expected, absl::Duration took) ABSL_LOCKS_EXCLUDED(mutex_);
  double BudgetLocked(SteadyTime now) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // What remains of what was added until now, as it is forgotten with time.
  double Remains(SteadyTime now) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Options options_;
  const double unit_;  // seconds of a point-frame at warm-up; 0: unknown
  const Clock& clock_;
  EngineMetrics& metrics_;
  mutable absl::Mutex mutex_;
  double expected_ ABSL_GUARDED_BY(mutex_) = 0;  // seconds of the batches lately, by the costs
  double took_ ABSL_GUARDED_BY(mutex_) = 0;      // and as they were
  SteadyTime last_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
