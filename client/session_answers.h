// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "api/point_tracker.h"
#include "client/final_filter.h"
#include "client/send_queue.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// What the servers of one session answer, on its way to the observer: calls follow each other, the observer sees one
// session. Checkpoints let the queue go of what it keeps. Not thread-safe.
class SessionAnswers {
 public:
  // Neither is owned; both must outlive this.
  SessionAnswers(TrackObserver& observer, SendQueue& queue) : observer_(observer), queue_(queue) {}

  // A call begins.
  void Begin(const SessionAccepted& accepted);
  // An error when the server sent what makes no sense.
  absl::Status Deliver(const v1::TrackResponse& response);

  // The newest one that the session can go on from.
  const std::optional<Checkpoint>& checkpoint() const { return checkpoint_; }
  // Of the last call, once it has come.
  const std::optional<SessionSummary>& summary() const { return summary_; }
  // Frames were processed, since the last call of this, that no call before had come to.
  bool TakeProgress() { return std::exchange(progressed_, false); }

 private:
  absl::Status DeliverTracks(const v1::Tracks& message);
  absl::Status DeliverCheckpoint(v1::Checkpoint message);
  void Remember(Checkpoint checkpoint);

  TrackObserver& observer_;
  SendQueue& queue_;
  FinalFilter filter_;
  std::optional<Checkpoint> checkpoint_;
  std::optional<SessionSummary> summary_;
  bool begun_ = false;
  bool progressed_ = false;
  int window_frames_ = 0;
};

}  // namespace holdfast
