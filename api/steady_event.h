// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>

#include "absl/time/time.h"

namespace holdfast {

// Something that happens, and that one thread waits for, for a limited time. Thread-safe.
// The limit follows the steady clock. absl's waits with a timeout do not, in the version of Debian 12: they compute a
// deadline of the wall clock, and one that is set back by an hour during a wait prolongs it by an hour.
class SteadyEvent {
 public:
  void Notify() {
    const std::lock_guard<std::mutex> lock(mutex_);
    happened_ = true;
    changed_.notify_all();
  }

  // True when Notify was called since the last wait that returned true; false when the time is over.
  bool WaitFor(absl::Duration timeout) {
    constexpr absl::Duration kLongest = absl::Hours(24 * 365);  // an infinite one would overflow the clock's type
    std::unique_lock<std::mutex> lock(mutex_);
    const auto nanoseconds = absl::ToChronoNanoseconds(std::min(timeout, kLongest));
    if (!changed_.wait_for(lock, nanoseconds, [this] { return happened_; })) return false;
    happened_ = false;
    return true;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool happened_ = false;
};

}  // namespace holdfast
