// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "absl/time/time.h"

namespace holdfast {

// How long to wait before the next of several attempts: longer each time, and never as long as others do, so that
// clients that lost the same server do not all come back at once. Not thread-safe.
class Backoff {
 public:
  struct Options {
    absl::Duration first = absl::Milliseconds(100);
    absl::Duration longest = absl::Seconds(5);
    double factor = 1.6;
    double jitter = 0.2;  // a wait is this part longer or shorter, at most
  };

  // 'random' gives numbers of [0, 1).
  Backoff(const Options& options, std::function<double()> random);

  absl::Duration Next();
  // As if there had been no attempt.
  void Reset() { wait_ = options_.first; }

 private:
  const Options options_;
  const std::function<double()> random_;
  absl::Duration wait_;  // the next one, without jitter
};

}  // namespace holdfast
