// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session.h"

#include <algorithm>
#include <utility>

#include "api/errors.h"
#include "server/engine/input/object_input.h"
#include "server/engine/status_of.h"

namespace holdfast {
namespace {

constexpr absl::Duration kFlowTurn = absl::Milliseconds(20);  // then frames and the flow of others have theirs
constexpr int64_t kPyramidsInUse = 2;                         // a job may hold frames that the session has forgotten

bool UsesFlow(const SessionAccepted& accepted) {
  return accepted.motion_prior || accepted.polish || accepted.emit == Emit::kEveryFrame;
}

// The surroundings of queries: points that are lost are looked for by them, and final positions are polished.
bool KeepsPatches(const SessionAccepted& accepted) { return accepted.motion_prior || accepted.polish; }

std::unique_ptr<SessionFlow> MakeFlow(const Session::Options& options) {
  if (!UsesFlow(options.accepted)) return nullptr;
  SessionFlow::Options flow;
  flow.starts = options.accepted.motion_prior;
  flow.live = options.accepted.emit == Emit::kEveryFrame;
  flow.patches = KeepsPatches(options.accepted);
  flow.window_frames = options.windows.frames;
  flow.visible_above = options.confidence.visible_above();
  return std::make_unique<SessionFlow>(flow);
}

// 'suspended': the client has what it needs to go on elsewhere.
SessionOutcome OutcomeOf(const absl::Status& status, bool suspended) {
  if (suspended) return SessionOutcome::kSuspended;
  if (status.ok()) return SessionOutcome::kCompleted;
  if (absl::IsCancelled(status)) return SessionOutcome::kCancelled;
  // A session that the server's end cut off without a checkpoint has failed, though nothing is wrong with the server.
  const bool failed = IsServersFault(status) || absl::IsUnavailable(status);
  return failed ? SessionOutcome::kFailed : SessionOutcome::kClientError;
}

}  // namespace

int64_t Session::FlowBytes(const Options& options) {
  if (!UsesFlow(options.accepted)) return 0;
  // Those of the cache, those that finished windows are polished on, those not encoded yet, and two in use.
  const int64_t frames =
      options.max_cached_frames + options.windows.hop + options.inbox.max_pending_frames + kPyramidsInUse;
  const int64_t patches = KeepsPatches(options.accepted) ? options.inbox.limits.max_points : 0;
  return frames * FlowPyramid::MostBytes(options.accepted.processing_size) + patches * FlowPatch::kBytes;
}

Session::Session(const Options& options, SessionListener& listener, Clock& clock, EngineMetrics& metrics,
                 Threads threads, std::unique_ptr<Admission::Ticket> ticket)
    : options_(options),
      clock_(clock),
      metrics_(metrics),
      threads_(std::move(threads)),
      inbox_(options.inbox),
      flow_(MakeFlow(options)),
      polish_(options.accepted.polish ? std::make_unique<SessionPolish>(*flow_) : nullptr),
      report_(options.provisional, {options.windows.frames, options.windows.revise_last ? 0 : options.windows.hop},
              listener, clock, metrics, inbox_),
      ticket_(std::move(ticket)),
      tracks_(options.windows, options.provisional, options.confidence),
      reseeding_(options.accepted.processing_size, inbox_, tracks_, flow_.get()) {}

void Session::SetFlowGeometry() {
  const ImageSize processing = options_.accepted.processing_size, flow = flow_size();
  const auto scale = [this](int flow_side, int processing_side) {
    return static_cast<float>(options_.stride) * static_cast<float>(flow_side) / static_cast<float>(processing_side);
  };
  flow_->SetGeometry(geometry(), {scale(flow.width, processing.width), scale(flow.height, processing.height)});
}

absl::StatusOr<Room> Session::PushFrame(Frame frame) {
  const int64_t index = frame.index;
  const std::optional<absl::Time> capture_time = frame.capture_time;
  const SteadyTime now = clock_.SteadyNow();
  absl::StatusOr<Room> room = inbox_.Push(std::move(frame), now);
  // After the end every call gets its status, which is about another frame.
  if (absl::IsInvalidArgument(room.status()) && room.status() != inbox_.end_status())
    metrics_.FrameDone(FrameResult::kRejected);
  if (!room.ok() || index < options_.accepted.first_frame) return room;
  report_.Arrived(now, capture_time);
  if (index == 0 && flow_ != nullptr) SetFlowGeometry();
  threads_.submit([self = shared_from_this(), index] {
    self->Decode(index);
    self->threads_.notify();
    self->AdvanceFlow();
  });
  return room;
}

absl::Status Session::AddPoints(const std::vector<PointQuery>& points) {
  absl::Status status = inbox_.AddPoints("add_points.points", points);
  SubmitFlow();
  return status;
}

absl::Status Session::RemovePoints(const std::vector<PointId>& ids) { return inbox_.RemovePoints(ids); }

void Session::Decode(int64_t index) {
  const std::optional<std::string> bytes = inbox_.TakeBytes(index);
  if (!bytes) return;
  const SteadyTime begin = clock_.SteadyNow();
  const std::vector<WaitingObject> objects = inbox_.TakeObjects(index);
  const bool wants_gray = flow_ != nullptr || !objects.empty();
  GrayImage gray;
  if (wants_gray) gray.size = flow_size();
  // The inbox has checked the frame when it came.
  auto image = DecodeFrame(*bytes, options_.inbox.format, inbox_.frame_size(), options_.accepted.processing_size,
                           wants_gray ? &gray : nullptr);
  if (image.ok() && !objects.empty()) {
    // Before the frame is there for those who take what was said at it.
    if (absl::Status placed = PlaceObjects(index, objects, gray); !placed.ok()) image = std::move(placed);
  }
  const SteadyTime end = clock_.SteadyNow();
  if (flow_ != nullptr && image.ok()) {
    RunFlow([&] { flow_->AddFrame(index, std::make_shared<FlowPyramid>(gray)); });
  }
  const bool rejected = !image.ok();
  if (inbox_.SetDecoded(index, std::move(image), end) && rejected) metrics_.FrameDone(FrameResult::kRejected);
  metrics_.StageTook(Stage::kDecode, Between(begin, end));
  report_.Work({Stage::kDecode, begin, end, index, 1});
}

absl::Status Session::PlaceObjects(int64_t index, absl::Span<const WaitingObject> objects, const GrayImage& gray) {
  for (const WaitingObject& object : objects) {
    const absl::StatusOr<PlacedObject> placed = PlaceObject(object.query, object.field, inbox_.frame_size(), gray);
    if (!placed.ok()) return placed.status();
    report_.WithObjects(
        [&](SessionObjects& objects) { objects.Add(object.query, index, placed->shape, placed->points); });
    inbox_.PlaceObject(object.query.id, index, placed->points);
  }
  return absl::OkStatus();
}

void Session::SubmitFlow() {
  if (flow_ == nullptr || flow_job_waits_.exchange(true)) return;
  threads_.submit([self = shared_from_this()] {
    self->flow_job_waits_ = false;
    self->AdvanceFlow();
  });
}

void Session::AdvanceFlow() {
  if (flow_ != nullptr && flow_->BeginSteps()) StepFlow();
}

void Session::StepFlow() {
  const SteadyTime turn = clock_.SteadyNow();
  bool more = false;
  const auto took_a_step = [&](bool (SessionFlow::*step)()) {
    if (more) return false;
    const SteadyTime begin = clock_.SteadyNow();
    if (!(flow_.get()->*step)()) return false;
    const SteadyTime end = clock_.SteadyNow();
    metrics_.StageTook(Stage::kFlow, Between(begin, end));
    more = Between(turn, end) > kFlowTurn;
    return true;
  };
  RunFlow([&] {
    do {
      // Chains may grow over newer frames meanwhile, of whose points nothing is known yet.
      const int64_t newest = flow_->newest();
      FetchOps(newest, /*applied=*/false);
      while (took_a_step(&SessionFlow::Step)) {
      }
      report_.Live(*flow_, newest);  // before the searches, which take longer
    } while (took_a_step(&SessionFlow::Search) || (!more && !flow_->EndSteps()));
  });
  threads_.notify();  // windows may have their starts now
  if (more) {
    threads_.submit([self = shared_from_this()] { self->StepFlow(); });
  }
}

void Session::FetchOps(int64_t newest, bool applied) {
  absl::MutexLock lock(&ops_mutex_);
  const std::vector<PointOp> ops = inbox_.TakeOps(newest, applied);
  if (flow_ != nullptr) flow_->Apply(ops);
  ops_.insert(ops_.end(), ops.begin(), ops.end());
}

std::vector<PointOp> Session::TakeOps(int64_t newest) {
  FetchOps(newest, /*applied=*/true);
  std::vector<PointOp> ops;
  absl::MutexLock lock(&ops_mutex_);
  for (; !ops_.empty() && ops_.front().frame <= newest; ops_.pop_front()) ops.push_back(ops_.front());
  return ops;
}

bool Session::AnyOps() {
  absl::MutexLock lock(&ops_mutex_);
  return !ops_.empty();
}

void Session::RunFlow(absl::FunctionRef<void()> work) {
  const absl::Status status = StatusOf(work, "optical flow failed");
  absl::MutexLock lock(&flow_failure_mutex_);
  flow_failure_.Update(status);
}

void Session::AwaitDone() {
  absl::MutexLock lock(&done_mutex_);
  while (!done_) done_changed_.Wait(&done_mutex_);
}

int64_t Session::FramesReady() const {
  int64_t room = options_.max_cached_frames - tracks_.cache().size();
  if (flow_ != nullptr) {
    const int64_t pyramids = tracks_.cache().newest() + 1 - flow_->oldest();
    room = std::min(room, options_.max_cached_frames + options_.windows.hop - pyramids);
  }
  return std::min(inbox_.ready(), room);
}

std::vector<DecodedFrame> Session::TakeFrames(int64_t count) {
  SessionInbox::Taken taken = inbox_.TakeFrames(count);
  if (taken.room) report_.RoomForFrame();
  const SteadyTime now = clock_.SteadyNow();
  for (const DecodedFrame& frame : taken.frames) metrics_.StageTook(Stage::kQueue, Between(frame.decoded, now));
  return std::move(taken.frames);
}

void Session::Admit(const DecodedFrame& frame, FrameFeaturesPtr features, TrackerModel& model) {
  if (frame.index == 0) tracks_.SetGeometry(geometry());
  tracks_.AddFrame(std::move(features));
  summary_.frames = std::max(summary_.frames, frame.index + 1);
  report_.Processed(summary_.frames);
  metrics_.FrameDone(FrameResult::kTracked);
  metrics_.SessionLag(inbox_.frames_received() - summary_.frames);
  ApplyOps(model);
}

void Session::ApplyOps(TrackerModel& model) {
  const std::vector<PointOp> ops = TakeOps(tracks_.cache().newest());
  const int64_t before = tracks_.tracks();
  for (const PointOp& op : ops) {
    summary_.points += op.seeds;
    if (op.frame != newest_seeds_.frame) newest_seeds_ = {op.frame, 0};
    newest_seeds_.count += op.seeds;
  }
  for (size_t i = 0; i < ops.size();) {
    if (ops[i].kind == PointOp::Kind::kRemove) {
      Remove(ops[i]);
      ++i;
      continue;
    }
    // Consecutive seeds of a frame are sampled together.
    size_t end = i + 1;
    while (end < ops.size() && ops[end].kind == PointOp::Kind::kSeed && ops[end].frame == ops[i].frame) ++end;
    SeedTracks(absl::MakeSpan(ops).subspan(i, end - i), model, tracks_);
    i = end;
  }
  CountPoints(before);
}

void Session::Remove(const PointOp& removal) {
  const std::vector<PointId> points =
      report_.WithObjects([&](SessionObjects& objects) { return objects.Remove(removal.query.id, removal.frame); });
  for (const PointId id : points) {
    tracks_.Remove(id, removal.frame);
    // Of a point that was placed anew the flow was told another id.
    if (flow_ != nullptr && id != removal.query.id) {
      flow_->Apply({{PointOp::Kind::kRemove, removal.frame, {id}}});
    }
  }
}

bool Session::ReseedObjects(TrackerModel& model) {
  const int64_t before = tracks_.tracks();
  const std::optional<int64_t> points =
      report_.WithObjects([&](SessionObjects& objects) { return reseeding_.Run(objects, model); });
  if (!points) return false;
  summary_.points += *points;
  CountPoints(before);
  SubmitFlow();
  return true;
}

void Session::CountPoints(int64_t before) {
  const int64_t delta = tracks_.tracks() - before;
  if (delta == 0) return;
  metrics_.PointsActive(delta);
  if (ticket_ != nullptr) ticket_->SetPoints(tracks_.tracks());
}

std::vector<DueRow> Session::DueRows() {
  // Who resumes a session that is suspended says how it ends. Points that are removed on the last frame end before.
  const SessionInbox::Standing stream = inbox_.standing();
  const bool ended = stream.drained && !AnyOps() && !stream.suspended && !CatchingUp() && !OwesLastCheckpoint(stream);
  std::vector<DueRow> rows = tracks_.Due(ended);
  // Nobody else's windows wait for who speaks to the listener.
  const auto of_object = [](const DueRow& row) { return IsObjectPoint(row.track->id()); };
  if (std::any_of(rows.begin(), rows.end(), of_object)) {
    report_.WithObjects([&](const SessionObjects& objects) {
      const auto waits = [&](const DueRow& row) { return objects.Holds(row.track->id(), row.track->next_start()); };
      rows.erase(std::remove_if(rows.begin(), rows.end(), waits), rows.end());
    });
  }
  if (!options_.accepted.motion_prior) return rows;
  rows.erase(std::remove_if(rows.begin(), rows.end(),
                            [this](const DueRow& row) { return !flow_->Reaches(row.track->serial(), row.plan.last); }),
             rows.end());
  return rows;
}

void Session::AddStarts(std::vector<DueRow>& rows) const {
  if (!options_.accepted.motion_prior) return;
  for (DueRow& row : rows) row.carried = flow_->Starts(row.track->serial(), row.plan.last);
}

void Session::Apply(absl::Span<const DueRow> rows, RowEstimate* estimates) {
  std::vector<PointRun> runs;
  for (const DueRow& row : rows) {
    if (auto run = tracks_.Apply(row, std::move(*estimates++))) runs.push_back(*std::move(run));
  }
  StartChains(rows);
  // A session that was cancelled meanwhile wants no more results.
  if (!inbox_.cancelled()) Deliver(std::move(runs));
}

SessionFlow::Base Session::BaseOf(const PointTrack& track, bool early) {
  return {track.serial(),           track.estimated_before() - 1, track.newest_position(),  track.newest_confidence(),
          track.newest_assurance(), track.worth_a_search(),       track.next_window_last(), early};
}

void Session::StartChains(absl::Span<const DueRow> rows) {
  if (flow_ == nullptr) return;
  std::vector<SessionFlow::Base> bases;
  for (const DueRow& row : rows) bases.push_back(BaseOf(*row.track, row.plan.kind == WindowKind::kEarly));
  flow_->Rebase(bases);
  SubmitFlow();
}

void Session::StartPolish() {
  if (polish_ == nullptr || !polish_->Start(tracks_)) return;
  threads_.submit([self = shared_from_this()] { self->PolishNextFrame(); });
}

void Session::PolishNextFrame() {
  const SteadyTime begin = clock_.SteadyNow();
  bool more = false;
  RunFlow([&] { more = polish_->Step(); });
  metrics_.StageTook(Stage::kFlow, clock_.Since(begin));
  if (more) {
    threads_.submit([self = shared_from_this()] { self->PolishNextFrame(); });
  } else {
    threads_.notify();
  }
}

bool Session::FinishPolish() {
  std::vector<PointRun> runs;
  if (polish_ == nullptr || !polish_->Finish(tracks_, runs)) return false;
  Deliver(std::move(runs));
  return true;
}

void Session::Deliver(std::vector<PointRun> runs, absl::Span<const TrackSet::Dropped> ended) {
  for (const PointRun& run : runs) summary_.final_samples += run.final_count;
  report_.Tracks(std::move(runs), ended, tracks_.cache().newest());
}

void Session::TellEncoded(const std::vector<DecodedFrame>& frames, SteadyTime begin, SteadyTime end) {
  report_.Work({Stage::kEncode, begin, end, frames.front().index, static_cast<int64_t>(frames.size())});
}

void Session::TellRefined(absl::Span<const DueRow> rows, SteadyTime begin, SteadyTime end) {
  if (rows.empty()) return;  // others had their turn
  report_.Work({Stage::kRefine, begin, end, rows.front().plan.first, static_cast<int64_t>(rows.size())});
}

void Session::EndTracks() {
  const int64_t before = tracks_.tracks();
  std::vector<PointRun> ended = tracks_.TakeEnded();
  CountPoints(before);
  const std::vector<TrackSet::Dropped> dropped = tracks_.TakeDropped();
  for (const TrackSet::Dropped& track : dropped) {
    if (flow_ != nullptr) flow_->Drop(track.serial);
  }
  if (!dropped.empty()) Deliver(std::move(ended), dropped);
}

void Session::Evict() {
  tracks_.Evict(report_.WithObjects([](const SessionObjects& objects) { return objects.oldest_meeting(); }));
  if (flow_ != nullptr) flow_->EvictBefore(std::min(tracks_.cache().oldest(), tracks_.oldest_for_polish()));
  report_.Final(tracks_.reported_before(), tracks_.cache().oldest());
}

absl::Status Session::FlowFailure() {
  absl::MutexLock lock(&flow_failure_mutex_);
  return flow_failure_;
}

int64_t Session::CachedBytes() const { return tracks_.cache().bytes() + (flow_ == nullptr ? 0 : flow_->bytes()); }

bool Session::FinishTurn(TrackerModel& model) {
  if (closed_) return false;
  // One that is suspended from here on is so for the next turn: what is here is not all that there will be.
  const SessionInbox::Standing stream = inbox_.standing();
  if (const absl::Status ended = stream.cancelled ? stream.end_status : FlowFailure(); !ended.ok()) {
    Close(ended);
    return false;
  }
  bool busy = FinishPolish();
  if (CatchingUp() && !stream.suspended) {
    Evict();
    if (stream.drained) Close(EndedTooEarly(stream.end_status));
    return busy;
  }
  if (!CatchingUp()) EndTracks();
  busy = ReseedObjects(model) || busy;
  if (stream.suspended) {
    Suspend(stream.end_status);
    return false;
  }
  if (OwesLastCheckpoint(stream) && stream.drained) {
    told_last_checkpoint_ = true;
    SendCheckpoint(++checkpoints_, State());
    return true;
  }
  StartPolish();
  if (tracks_.tracks() == 0) report_.Progress();  // otherwise estimates say it
  Evict();
  StartCheckpoint(stream.end_status);
  if (!stream.drained || AnyOps() || tracks_.AnyDue(/*ended=*/true)) return busy;
  return !FinishStream(stream.end_status) && busy;
}

bool Session::FinishStream(const absl::Status& status) {
  const auto any_meeting = [](const SessionObjects& objects) { return objects.AnyMeeting(); };
  // The last windows may be those of points to come.
  if (tracks_.AnyUnpolished() && report_.WithObjects(any_meeting)) return false;
  tracks_.FinalizeAll();
  StartPolish();
  if (tracks_.AnyUnpolished()) return false;
  const int64_t left = tracks_.tracks();
  std::vector<PointRun> last = tracks_.FinishAll();
  if (flow_ != nullptr) flow_->Close();  // no instant estimate may follow final ones
  CountPoints(left);
  Deliver(std::move(last));
  report_.Final(tracks_.reported_before(), tracks_.cache().oldest());
  Close(status);
  return true;
}

void Session::Close(const absl::Status& status) {
  if (closed_) return;
  closed_ = true;
  inbox_.Close(status);
  if (flow_ != nullptr) flow_->Close();
  for (int64_t dropped = inbox_.TakeDropped(); dropped > 0; --dropped) metrics_.FrameDone(FrameResult::kDropped);
  CountPoints(tracks_.Clear());
  metrics_.SessionClosed(OutcomeOf(status, suspended_));
  ticket_.reset();  // before OnSessionDone: who hears of the end may come back at once
  report_.Done(status, summary_);
  absl::MutexLock lock(&done_mutex_);
  done_ = true;
  done_changed_.SignalAll();
}

}  // namespace holdfast
