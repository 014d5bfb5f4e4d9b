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
  const auto sent = static_cast<int64_t>(sent_.size());
  int64_t first = sent, before = 0;
  for (const PointRun& run : update.runs) {
    first = std::min(first, run.first_frame);
    before = std::max(before, run.first_frame + static_cast<int64_t>(run.x.size()));
  }
  before = std::min(before, sent);
  for (int64_t frame = std::max(first, answered_); frame < before; ++frame) {
    waited_.Add(Between(sent_[static_cast<size_t>(frame)], now));
  }
  return answered_ = std::max(answered_, before);
}

int64_t AnswerTimes::answered() const {
  absl::MutexLock lock(&mutex_);
  return answered_;
}

std::string AnswerTimes::Summary() const {
  absl::MutexLock lock(&mutex_);
  if (waited_.count() == 0) return "";
  return absl::StrFormat("first estimate of a frame after %.0f ms (median), %.0f ms (95 %% of frames)\n",
                         absl::ToDoubleMilliseconds(waited_.Percentile(50)),
                         absl::ToDoubleMilliseconds(waited_.Percentile(95)));
}

}  // namespace holdfast
