// SPDX-License-Identifier: Apache-2.0
#include "client/cli/answer_times.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace holdfast {

void AnswerTimes::Sent() {
  const SteadyTime now = now_();
  absl::MutexLock lock(&mutex_);
  sent_.push_back(now);
}

int64_t AnswerTimes::Answered(const TrackUpdate& update) {
  const SteadyTime now = now_();
  absl::MutexLock lock(&mutex_);
  int64_t before = 0;
  for (const PointRun& run : update.runs) {
    before = std::max(before, run.first_frame + static_cast<int64_t>(run.x.size()));
  }
  before = std::min(before, static_cast<int64_t>(sent_.size()));
  while (static_cast<int64_t>(waited_.count()) < before) waited_.Add(Between(sent_[waited_.count()], now));
  return static_cast<int64_t>(waited_.count());
}

int64_t AnswerTimes::answered() const {
  absl::MutexLock lock(&mutex_);
  return static_cast<int64_t>(waited_.count());
}

std::string AnswerTimes::Summary() const {
  absl::MutexLock lock(&mutex_);
  if (waited_.count() == 0) return "";
  return absl::StrFormat("first estimate of a frame after %.0f ms (median), %.0f ms (95 %% of frames)\n",
                         absl::ToDoubleMilliseconds(waited_.Percentile(50)),
                         absl::ToDoubleMilliseconds(waited_.Percentile(95)));
}

}  // namespace holdfast
