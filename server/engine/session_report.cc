// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_report.h"

#include <algorithm>

#include "server/engine/objects/object_state.h"

namespace holdfast {

SessionReport::SessionReport(bool provisional, const ObjectWindows& windows, SessionListener& listener, Clock& clock,
                             EngineMetrics& metrics, const SessionInbox& inbox)
    : listener_(listener),
      tells_work_(listener.wants_work()),
      clock_(clock),
      metrics_(metrics),
      inbox_(inbox),
      latency_(metrics),
      objects_(provisional, windows) {}

void SessionReport::Resume(SessionState& state) {
  processed_ = state.summary.frames;
  latency_.StartAt(state.next_frame, state.taken_frame + 1);
  capture_times_.StartAt(state.next_frame);
  absl::MutexLock lock(&mutex_);
  told_processed_ = processed_;
  for (ObjectState& object : state.objects) objects_.Restore(std::move(object));
}

void SessionReport::Arrived(SteadyTime when, std::optional<absl::Time> capture_time) {
  latency_.Arrived(when);
  capture_times_.Push(capture_time);
}

void SessionReport::Final(int64_t reported, int64_t oldest) {
  latency_.Final(reported, clock_.SteadyNow());
  capture_times_.EvictBefore(std::min(reported, oldest));
}

void SessionReport::RoomForFrame() {
  absl::MutexLock lock(&mutex_);
  listener_.OnRoomForFrame();
}

void SessionReport::Work(const StageWork& work) {
  if (!tells_work_) return;
  absl::MutexLock lock(&mutex_);
  if (!done_) listener_.OnWork(work);
}

void SessionReport::Tracks(std::vector<PointRun> runs, absl::Span<const TrackSet::Dropped> ended, int64_t newest) {
  absl::MutexLock lock(&mutex_);
  for (const TrackSet::Dropped& track : ended) objects_.Close(track.id, track.frame);
  objects_.Reach(newest);
  Emit(std::move(runs));
}

void SessionReport::Live(SessionFlow& flow, int64_t newest) {
  // Taken under the lock, so that no estimate of a window overtakes one that it revises.
  absl::MutexLock lock(&mutex_);
  if (done_) return;
  std::vector<PointRun> runs = flow.TakeLive(newest);
  if (!runs.empty()) Emit(std::move(runs));
}

void SessionReport::Emit(std::vector<PointRun> runs) {
  const SteadyTime begin = clock_.SteadyNow();
  std::vector<ObjectRun> objects = objects_.Report(runs);
  if (runs.empty() && objects.empty()) return;
  for (const PointRun& run : runs) {
    latency_.Estimated(run.first_frame, run.first_frame + static_cast<int64_t>(run.x.size()), begin);
  }
  const int64_t first_frame = runs.empty() ? objects.front().first_frame : runs.front().first_frame;
  const int64_t points = static_cast<int64_t>(runs.size());
  std::vector<FrameTime> times = capture_times_.Of(runs);
  Send({std::move(runs), inbox_.frames_received(), processed_, std::move(times), std::move(objects)});
  const SteadyTime end = clock_.SteadyNow();
  metrics_.StageTook(Stage::kEmit, Between(begin, end));
  if (tells_work_) listener_.OnWork({Stage::kEmit, begin, end, first_frame, points});
}

void SessionReport::Send(TrackUpdate update) {
  told_processed_ = update.frames_processed;
  listener_.OnTracks(std::move(update));
}

void SessionReport::Progress() {
  absl::MutexLock lock(&mutex_);
  if (told_processed_ < processed_) Send({{}, inbox_.frames_received(), processed_});
}

void SessionReport::CheckpointTaken(int64_t order, const absl::Status& sealed, std::optional<Checkpoint> checkpoint) {
  absl::MutexLock lock(&mutex_);
  if (done_ || order < told_checkpoint_) return;
  if (!sealed.ok()) listener_.OnWarning(sealed);
  if (!checkpoint) return;
  told_checkpoint_ = order;
  listener_.OnCheckpoint(*std::move(checkpoint));
}

void SessionReport::Done(const absl::Status& status, const SessionSummary& summary) {
  absl::MutexLock lock(&mutex_);
  done_ = true;
  listener_.OnSessionDone(status, summary);
}

}  // namespace holdfast
