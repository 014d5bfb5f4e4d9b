// SPDX-License-Identifier: Apache-2.0
#include "client/cli/backward_pass.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

template <typename T>
std::vector<T> Backwards(const std::vector<T>& values, int64_t begin, int64_t end) {
  return {values.rend() - end, values.rend() - begin};
}

}  // namespace

std::vector<PointRun> ReversedRuns(const PointRun& run, int64_t last, int64_t end) {
  const auto length = static_cast<int64_t>(run.x.size());
  const int64_t skipped = std::clamp<int64_t>(last - end + 1 - run.first_frame, 0, length);
  const int64_t finals = std::clamp<int64_t>(run.final_count, skipped, length);
  std::vector<PointRun> runs;
  for (const auto& [from, to] : {std::pair(skipped, finals), std::pair(finals, length)}) {
    if (from == to) continue;
    runs.push_back({run.id, last - (run.first_frame + to - 1), Backwards(run.x, from, to), Backwards(run.y, from, to),
                    Backwards(run.visible, from, to), Backwards(run.confidence, from, to),
                    to == finals ? to - from : 0});
  }
  return runs;
}

BackwardPass::BackwardPass(SessionConfig config, const std::vector<PastQuery>& queries, const FrameSpool& frames,
                           TrackObserver& events, Deliver deliver)
    : config_(std::move(config)), frames_(frames), events_(events), deliver_(std::move(deliver)) {
  for (const PastQuery& query : queries) last_ = std::max(last_, query.frame);
  for (const PastQuery& query : queries) {
    queried_[query.point.id] = query.frame;
    starts_[last_ - query.frame].push_back(query.point);
  }
  config_.points = starts_[0];
}

absl::Status BackwardPass::Run(PointTracker& tracker, StopSignal& stop) {
  auto stream = tracker.Open(config_, *this);
  if (!stream.ok()) return stream.status();
  stop.SetCallback([&stream] { (*stream)->Cancel(); });
  absl::Status status = PushFrames(**stream);
  if (status.ok()) status = (*stream)->Finish();
  stop.SetCallback([] {});
  stream->reset();  // no answer comes any more
  if (!status.ok() && stop.stopped()) return absl::CancelledError("interrupted");
  return status.ok() ? broken() : status;
}

absl::Status BackwardPass::PushFrames(TrackStream& stream) {
  for (int64_t i = 0; i <= last_; ++i) {
    absl::StatusOr<std::string> bytes = frames_.Read(last_ - i);
    if (!bytes.ok()) return bytes.status();
    const auto points = starts_.find(i);
    const bool late = i > 0 && points != starts_.end();
    absl::Status status =
        stream.PushFrame({i, *std::move(bytes), {}, late ? points->second : std::vector<PointQuery>()});
    status.Update(broken());
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status BackwardPass::broken() const {
  absl::MutexLock lock(&mutex_);
  return broken_;
}

void BackwardPass::OnTracks(TrackUpdate update) {
  TrackUpdate reversed;
  reversed.frames_processed = update.frames_processed;
  absl::MutexLock lock(&mutex_);
  for (const PointRun& run : update.runs) {
    const auto queried = queried_.find(run.id);
    if (queried == queried_.end() || run.first_frame < 0 || run.first_frame > last_) {
      broken_.Update(absl::InternalError(absl::StrCat("the tracker answered for point ", run.id, " on frame ",
                                                      run.first_frame, ", which was not sent")));
      return;
    }
    for (PointRun& part : ReversedRuns(run, last_, queried->second)) reversed.runs.push_back(std::move(part));
  }
  if (broken_.ok()) broken_ = deliver_(reversed);
}

void BackwardPass::OnResumed(const SessionAccepted& accepted) {
  SessionAccepted told = accepted;
  told.first_frame = last_ - accepted.first_frame;
  events_.OnResumed(told);
}

}  // namespace holdfast
