// SPDX-License-Identifier: Apache-2.0
#include "client/session_answers.h"

#include <utility>

#include "proto/convert.h"
#include "proto/grpc_status.h"

namespace holdfast {

void SessionAnswers::Begin(const SessionAccepted& accepted) {
  window_frames_ = accepted.window_frames;
  summary_.reset();
  if (std::exchange(begun_, true)) {
    filter_.Resume();
    observer_.OnResumed(accepted);
  } else {
    observer_.OnAccepted(accepted);
  }
}

absl::Status SessionAnswers::Deliver(const v1::TrackResponse& response) {
  if (const auto warning = queue_.TakeWarning()) observer_.OnWarning(*warning);
  switch (response.response_case()) {
    case v1::TrackResponse::kTracks:
      return DeliverTracks(response.tracks());
    case v1::TrackResponse::kCheckpoint:
      return DeliverCheckpoint(response.checkpoint());
    case v1::TrackResponse::kWarning:
      observer_.OnWarning(FromRpcStatus(response.warning()));
      return absl::OkStatus();
    case v1::TrackResponse::kGoingAway:
      observer_.OnGoingAway(FromProto(response.going_away()));
      return absl::OkStatus();
    case v1::TrackResponse::kSummary:
      summary_ = FromProto(response.summary());
      return absl::OkStatus();
    default:
      return absl::OkStatus();  // of a newer server; nothing this client could miss
  }
}

absl::Status SessionAnswers::DeliverTracks(const v1::Tracks& message) {
  absl::StatusOr<TrackUpdate> update = FromProto(message);
  if (!update.ok()) return update.status();
  const int64_t processed = filter_.frames_processed();
  filter_.Apply(*update);
  progressed_ |= filter_.frames_processed() > processed;
  observer_.OnTracks(*std::move(update));
  return absl::OkStatus();
}

absl::Status SessionAnswers::DeliverCheckpoint(v1::Checkpoint message) {
  absl::StatusOr<Checkpoint> checkpoint = FromProto(std::move(message));
  if (!checkpoint.ok()) return checkpoint.status();
  observer_.OnCheckpoint(*checkpoint);
  if (queue_.keeps()) Remember(*std::move(checkpoint));
  return absl::OkStatus();
}

void SessionAnswers::Remember(Checkpoint checkpoint) {
  if (checkpoint.token.empty()) {
    queue_.KeepNothing();
    observer_.OnWarning(absl::FailedPreconditionError(
        "the session has outgrown what a checkpoint can hold: it cannot be resumed when its server is lost"));
    return;
  }
  if (!queue_.DropBefore(checkpoint.next_frame)) return;  // of no use; the one before still is
  // Results that are not in a checkpoint come again with the session. They speak of frames that windows to come need,
  // and no further back than a window.
  filter_.ForgetBefore(checkpoint.next_frame - window_frames_);
  checkpoint_ = std::move(checkpoint);
}

}  // namespace holdfast
