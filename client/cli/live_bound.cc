// SPDX-License-Identifier: Apache-2.0
#include "client/cli/live_bound.h"

#include <algorithm>
#include <cmath>

#include "absl/time/time.h"

namespace holdfast {
namespace {

constexpr absl::Duration kPeriod = absl::Seconds(1);
constexpr int64_t kLeast = 2;  // one on the line while the other one is worked on
constexpr int64_t kMost = 8;

}  // namespace

void LiveBound::Answered(int64_t answered, SteadyTime now) {
  if (!answers_.empty() && answers_.back().second == answered) return;  // revised
  answers_.emplace_back(now, answered);
  while (answers_.size() > 2 && Between(answers_[1].first, now) >= kPeriod) answers_.pop_front();
  const absl::Duration since = Between(answers_.front().first, now);
  if (since <= absl::ZeroDuration()) return;
  const auto count = static_cast<double>(answered - answers_.front().second);
  frames_ = std::clamp<int64_t>(std::llround(count * absl::FDivDuration(kPeriod, since)) + 1, kLeast, kMost);
}

}  // namespace holdfast
