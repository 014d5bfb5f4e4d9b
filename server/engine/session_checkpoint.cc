// SPDX-License-Identifier: Apache-2.0
// How a session ends on one server and goes on at another.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "server/engine/session.h"
#include "server/engine/status_of.h"

namespace holdfast {

void Session::Resume(SessionState state) {
  taken_frame_ = checkpoint_frame_ = state.taken_frame;
  summary_ = state.summary;
  report_.Resume(state);
  tracks_.SetGeometry(geometry());
  tracks_.StartAt(state.next_frame);
  if (flow_ != nullptr) {
    SetFlowGeometry();
    flow_->StartAt(state.next_frame);
  }
  for (SessionState::Track& saved : state.tracks) {
    const PointTrack& track = tracks_.Restore(std::move(saved.state));
    if (flow_ != nullptr)
      RestoreFlow(track, saved.patch ? ReadPatch(saved.patch->at, saved.patch->code) : std::nullopt);
  }
  CountPoints(0);
}

void Session::RestoreFlow(const PointTrack& track, std::optional<FlowPatch> patch) {
  const PointSeed& seed = track.seed();
  const TrackState::Ending ending = track.ending_at();
  flow_->Restore({{PointOp::Kind::kSeed, seed.frame, seed.query, seed.serial},
                  track.ending(),
                  ending.last_frame,
                  ending.stop,
                  std::move(patch)});
  if (track.estimated_before() > seed.frame + 1) flow_->Rebase({BaseOf(track, /*early=*/!track.began())});
}

SessionState Session::State() {
  SessionState state;
  const SessionAccepted& accepted = options_.accepted;
  state.weights_sha256 = options_.weights_sha256;
  state.encoding = options_.inbox.format.encoding;
  state.frame_size = inbox_.frame_size();
  state.processing_size = accepted.processing_size;
  state.hop_frames = accepted.hop_frames;
  state.iterations = accepted.iterations;
  state.least_step = options_.least_step;
  state.motion_prior = accepted.motion_prior;
  state.polish = accepted.polish;
  const FeatureCache& cache = tracks_.cache();
  state.taken_frame = std::max(cache.newest(), taken_frame_);
  state.next_frame = flow_ == nullptr ? cache.oldest() : std::min(cache.oldest(), tracks_.oldest_for_polish());
  state.next_serial = inbox_.next_serial();
  state.summary = summary_;
  if (newest_seeds_.frame == state.taken_frame) state.summary.points -= newest_seeds_.count;
  report_.WithObjects([&](const SessionObjects& objects) {
    for (const auto& track : tracks_.all()) {
      if (track->seed().frame < state.taken_frame || objects.WasPlacedAnew(track->id(), state.taken_frame))
        state.tracks.push_back(SavedTrack(*track, state.taken_frame));
    }
    state.objects = objects.StatesBefore(state.taken_frame);
  });
  return state;
}

SessionState::Track Session::SavedTrack(const PointTrack& track, int64_t taken_frame) const {
  SessionState::Track saved;
  saved.state = track.state();
  if (saved.state.ending && saved.state.ending->last_frame == taken_frame) {
    // Its last window may have run already: what it made final beyond its end is another track's, or nobody's.
    const int64_t stop = saved.state.ending->stop;
    saved.state.final_before = std::min(saved.state.final_before, stop);
    saved.state.reportable_before = std::min(saved.state.reportable_before, stop);
    saved.state.ending.reset();
  }
  if (flow_ == nullptr) return saved;
  if (const auto patch = flow_->PatchOf(track.serial())) saved.patch = {patch->at, patch->code};
  return saved;
}

void Session::StartCheckpoint(const absl::Status& end_status) {
  if (!end_status.ok()) return;
  const int64_t interval = options_.accepted.checkpoint_interval_frames;
  const int64_t newest = tracks_.cache().newest();
  if (interval == 0 || newest < std::max<int64_t>(checkpoint_frame_ + interval, 1) || outgrown_ || sealing_) return;
  checkpoint_frame_ = newest;
  sealing_ = true;
  const int64_t order = ++checkpoints_;
  threads_.submit([self = shared_from_this(), order, state = std::make_shared<SessionState>(State())] {
    self->SendCheckpoint(order, *state);
    self->sealing_ = false;
    self->threads_.notify();
  });
}

bool Session::SendCheckpoint(int64_t order, const SessionState& state) {
  absl::StatusOr<std::string> token = absl::InternalError("");
  const absl::Status failed = StatusOf([&] { token = options_.sealer->Seal(state); }, "a checkpoint could not be made");
  std::optional<Checkpoint> checkpoint;  // none: the client keeps the one that it has
  if (!failed.ok()) {
    token = failed;
  } else if (token.ok()) {
    checkpoint = Checkpoint{*token, state.next_frame, options_.sealer->outlives_process()};
  } else if (absl::IsResourceExhausted(token.status())) {
    outgrown_ = true;
    checkpoint = Checkpoint{"", state.next_frame, false};
  }
  report_.CheckpointTaken(order, token.status(), std::move(checkpoint));
  return token.ok();
}

void Session::Suspend(const absl::Status& status) {
  const bool begun = tracks_.cache().newest() >= 1;  // before, there is nothing that the client has not
  suspended_ = !begun || (CanSeal() && SendCheckpoint(++checkpoints_, State()));
  Close(status);
}

// A session that ends for a mistake, or for silence, may be gone on with from before it.
bool Session::OwesLastCheckpoint(const SessionInbox::Standing& stream) const {
  return CanSeal() && !told_last_checkpoint_ && tracks_.cache().newest() >= 1 && !stream.suspended &&
         !stream.end_status.ok();
}

absl::Status Session::EndedTooEarly(const absl::Status& status) const {
  if (!status.ok()) return status;
  return InvalidFieldError("frame.index",
                           absl::StrCat("the stream ended after frame ", tracks_.cache().newest(),
                                        ", but the session that it resumes has come to frame ", taken_frame_));
}

}  // namespace holdfast
