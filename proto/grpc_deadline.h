// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpc/support/time.h>

#include <algorithm>
#include <cstdint>
#include <limits>

#include "absl/time/time.h"

namespace holdfast {

// The deadline 'from_now' for any call of gRPC that takes one, by the steady clock: a std::chrono::system_clock time,
// as gRPC's examples have it, would move with the wall clock.
inline gpr_timespec SteadyDeadline(absl::Duration from_now) {
  const int64_t milliseconds = std::max<int64_t>(absl::ToInt64Milliseconds(from_now), 0);
  return gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC), gpr_time_from_millis(milliseconds, GPR_TIMESPAN));
}

// For channel arguments that are milliseconds; what is longer than they hold is as good as infinite to gRPC.
inline int ArgumentMilliseconds(absl::Duration duration) {
  return static_cast<int>(std::min<int64_t>(absl::ToInt64Milliseconds(duration), std::numeric_limits<int>::max()));
}

}  // namespace holdfast
