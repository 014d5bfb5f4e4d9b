// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {

// Stands still until it is moved by hand. Thread-safe.
class SimulatedClock final : public Clock {
 public:
  absl::Time WallNow() const override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return wall_;
  }
  SteadyTime SteadyNow() const override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    ++steady_reads_;
    return steady_;
  }

  // Time goes by.
  void Advance(absl::Duration duration) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    wall_ += duration;
    steady_ += absl::ToChronoNanoseconds(duration);
  }
  // Somebody sets the wall clock, forward or back; no time goes by.
  void SetWallBy(absl::Duration jump) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    wall_ += jump;
  }

  // Blocks until the steady time was asked for 'count' times more, by whatever thread.
  void AwaitSteadyReads(int64_t count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    const int64_t wanted = steady_reads_ + count;
    const auto reached = [this, wanted]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return steady_reads_ >= wanted; };
    mutex_.Await(absl::Condition(&reached));
  }

 private:
  mutable absl::Mutex mutex_;
  absl::Time wall_ ABSL_GUARDED_BY(mutex_) = absl::UnixEpoch() + absl::Hours(24 * 365);
  SteadyTime steady_ ABSL_GUARDED_BY(mutex_) = SteadyTime() + std::chrono::hours(1);
  mutable int64_t steady_reads_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace holdfast
