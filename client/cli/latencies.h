// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "absl/time/time.h"

namespace holdfast {

// Durations, and the shares of them that are shorter. Not thread-safe.
class Latencies {
 public:
  void Add(absl::Duration duration) { all_.push_back(duration); }
  void Add(const Latencies& other) { all_.insert(all_.end(), other.all_.begin(), other.all_.end()); }
  size_t count() const { return all_.size(); }
  // The shortest duration that 'percent' per cent of them, 0 to 100, do not exceed; zero when there are none.
  absl::Duration Percentile(double percent) const;

 private:
  std::vector<absl::Duration> all_;
};

}  // namespace holdfast
