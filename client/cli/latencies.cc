// SPDX-License-Identifier: Apache-2.0
#include "client/cli/latencies.h"

#include <algorithm>
#include <cmath>

namespace holdfast {

absl::Duration Latencies::Percentile(double percent) const {
  if (all_.empty()) return absl::ZeroDuration();
  std::vector<absl::Duration> sorted = all_;
  const double rank = std::ceil(percent / 100 * static_cast<double>(sorted.size()));
  const size_t at = std::min(sorted.size() - 1, static_cast<size_t>(std::max(rank - 1, 0.0)));
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(at), sorted.end());
  return sorted[at];
}

}  // namespace holdfast
