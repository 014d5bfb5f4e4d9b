// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace holdfast {

// A point of the steady time: meaningful only beside another one of the same process. A type of its own, so that it is
// never taken for a point of the wall time.
using SteadyTime = std::chrono::steady_clock::time_point;

inline absl::Duration Between(SteadyTime begin, SteadyTime end) { return absl::FromChrono(end - begin); }

// The two times of a program, injected so that tests can move each by hand. Thread-safe.
// The wall time is for stamps that others read: logs, file names, identities. It jumps by hours when somebody sets it.
// The steady time only ever advances, a second a second: every timeout, latency, drain, retry and budget is measured by
// it. Nothing in the programs asks the system for the time but through here; tests/clock_test.py keeps it so.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual absl::Time WallNow() const = 0;
  virtual SteadyTime SteadyNow() const = 0;

  absl::Duration Since(SteadyTime begin) const { return Between(begin, SteadyNow()); }
};

class SystemClock final : public Clock {
 public:
  absl::Time WallNow() const override { return absl::Now(); }
  SteadyTime SteadyNow() const override { return std::chrono::steady_clock::now(); }
};

}  // namespace holdfast
