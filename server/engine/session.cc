// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session.h"

#include <algorithm>
#include <utility>

namespace holdfast {

Session::Session(const Options& options, SessionListener& listener, Clock& clock, EngineMetrics& metrics,
                 std::unique_ptr<Admission::Ticket> ticket)
    : options_(options),
      listener_(listener),
      clock_(clock),
      metrics_(metrics),
      inbox_(options.inbox),
      ticket_(std::move(ticket)),
      tracks_(options.windows, options.provisional),
      latency_(metrics) {}

absl::StatusOr<Room> Session::PushFrame(Frame frame) {
  absl::StatusOr<Room> room = inbox_.Push(std::move(frame), clock_.SteadyNow());
  // After the end every call gets its status, which is about another frame.
  if (absl::IsInvalidArgument(room.status()) && room.status() != inbox_.end_status())
    metrics_.FrameDone(FrameResult::kRejected);
  return room;
}

void Session::Decode(int64_t index) {
  const std::optional<std::string> bytes = inbox_.TakeBytes(index);
  if (!bytes) return;
  const SteadyTime begin = clock_.SteadyNow();
  auto image = DecodeFrame(*bytes, options_.inbox.format, options_.accepted.processing_size);
  const SteadyTime end = clock_.SteadyNow();
  const bool rejected = !image.ok();
  if (inbox_.SetDecoded(index, std::move(image), end) && rejected) metrics_.FrameDone(FrameResult::kRejected);
  metrics_.StageTook(Stage::kDecode, Between(begin, end));
}

void Session::AwaitDone() {
  absl::MutexLock lock(&done_mutex_);
  while (!done_) done_changed_.Wait(&done_mutex_);
}

int64_t Session::FramesReady() const {
  return std::min(inbox_.ready(), options_.max_cached_frames - tracks_.cache().size());
}

std::vector<DecodedFrame> Session::TakeFrames(int64_t count) {
  SessionInbox::Taken taken = inbox_.TakeFrames(count);
  if (taken.room) listener_.OnRoomForFrame();
  const SteadyTime now = clock_.SteadyNow();
  for (const DecodedFrame& frame : taken.frames) metrics_.StageTook(Stage::kQueue, Between(frame.decoded, now));
  return std::move(taken.frames);
}

void Session::Admit(const DecodedFrame& frame, FrameFeaturesPtr features, TrackerModel& model) {
  if (frame.index == 0) {
    tracks_.SetGeometry(FrameGeometry(inbox_.frame_size(), options_.accepted.processing_size, options_.stride));
  }
  tracks_.AddFrame(std::move(features));
  latency_.Arrived(frame.arrival);
  ++summary_.frames;
  metrics_.FrameDone(FrameResult::kTracked);
  metrics_.SessionLag(inbox_.frames_received() - summary_.frames);
  ApplyOps(model);
}

void Session::ApplyOps(TrackerModel& model) {
  const std::vector<PointOp> ops = inbox_.TakeOps(tracks_.cache().newest());
  const int64_t before = tracks_.tracks();
  for (const PointOp& op : ops) summary_.points += op.seeds;
  for (size_t i = 0; i < ops.size();) {
    if (ops[i].kind == PointOp::Kind::kRemove) {
      tracks_.Remove(ops[i].query.id, ops[i].frame);
      ++i;
      continue;
    }
    // Consecutive seeds of a frame are sampled together.
    const int64_t frame = ops[i].frame;
    std::vector<PointQuery> queries;
    for (; i < ops.size() && ops[i].kind == PointOp::Kind::kSeed && ops[i].frame == frame; ++i) {
      queries.push_back(ops[i].query);
    }
    Seed(queries, frame, model);
  }
  CountPoints(before);
}

void Session::Seed(const std::vector<PointQuery>& queries, int64_t frame, TrackerModel& model) {
  std::vector<Position> positions;
  for (const PointQuery& query : queries) positions.push_back(tracks_.geometry().ToFeatures(query.x, query.y));
  std::vector<std::vector<float>> features = model.Sample(*tracks_.cache().At(frame), positions);
  for (size_t i = 0; i < queries.size(); ++i) {
    tracks_.Seed({queries[i], frame, positions[i], std::move(features[i])});
  }
}

void Session::CountPoints(int64_t before) {
  if (const int64_t delta = tracks_.tracks() - before; delta != 0) metrics_.PointsActive(delta);
}

void Session::Deliver(std::vector<PointRun> runs) {
  const SteadyTime begin = clock_.SteadyNow();
  for (const PointRun& run : runs) {
    latency_.Estimated(run.first_frame, run.first_frame + static_cast<int64_t>(run.x.size()), begin);
    summary_.final_samples += run.final_count;
  }
  if (runs.empty()) return;
  listener_.OnTracks({std::move(runs), inbox_.frames_received(), summary_.frames});
  metrics_.StageTook(Stage::kEmit, clock_.Since(begin));
}

void Session::Settle() {
  if (closed_) return;
  if (inbox_.cancelled()) return Close(inbox_.end_status());
  const int64_t before = tracks_.tracks();
  std::vector<PointRun> ended = tracks_.TakeEnded();
  CountPoints(before);
  if (!ended.empty()) Deliver(std::move(ended));
  tracks_.Evict();
  latency_.Final(tracks_.reported_before(), clock_.SteadyNow());
  if (!inbox_.drained() || tracks_.AnyDue(/*ended=*/true)) return;
  const int64_t left = tracks_.tracks();
  std::vector<PointRun> last = tracks_.FinishAll();
  CountPoints(left);
  Deliver(std::move(last));
  latency_.Final(tracks_.reported_before(), clock_.SteadyNow());
  Close(inbox_.end_status());
}

void Session::Close(const absl::Status& status) {
  if (closed_) return;
  closed_ = true;
  inbox_.Close(status);
  for (int64_t dropped = inbox_.TakeDropped(); dropped > 0; --dropped) metrics_.FrameDone(FrameResult::kDropped);
  CountPoints(tracks_.Clear());
  metrics_.SessionClosed(status.ok()                 ? SessionOutcome::kCompleted
                         : absl::IsCancelled(status) ? SessionOutcome::kCancelled
                                                     : SessionOutcome::kFailed);
  ticket_.reset();  // before OnDone: who hears of the end may come back at once
  listener_.OnDone(status, summary_);
  absl::MutexLock lock(&done_mutex_);
  done_ = true;
  done_changed_.SignalAll();
}

}  // namespace holdfast
