// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <utility>

#include "api/clock.h"

namespace holdfast {

// How many frames of a live input may be on their way to the server at once. What comes meanwhile is left out: in a
// queue it would only become old. It is what was answered within about a second, so that no frame waits much longer on
// a thin line, and one more, so that a line that carries more is found out. Not thread-safe.
class LiveBound {
 public:
  // 'answered': frames of the session, by now.
  void Answered(int64_t answered, SteadyTime now);
  int64_t frames() const { return frames_; }

 private:
  std::deque<std::pair<SteadyTime, int64_t>> answers_;  // of the last second, and the newest one before
  int64_t frames_ = 2;
};

}  // namespace holdfast
