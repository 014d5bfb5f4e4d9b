// SPDX-License-Identifier: Apache-2.0
// The interface that the in-process engine (LocalTracker) and the remote client (RemoteTracker) share, so that tools
// and tests run on either.
#pragma once

#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"

namespace holdfast {

// Receives what a session produces. Called on a thread of the tracker, one call at a time, in the order below:
// OnAccepted once, then the others any number of times, then OnDone once as the very last call.
// A session that is refused gets OnDone alone. Calls may arrive before PointTracker::Open has returned. An observer may
// take its time (the stream waits), but must not call the stream's blocking methods from here.
class TrackObserver {
 public:
  virtual ~TrackObserver() = default;
  virtual void OnAccepted(const SessionAccepted&) {}
  virtual void OnTracks(TrackUpdate update) = 0;
  virtual void OnWarning(const absl::Status&) {}
  virtual void OnCheckpoint(const Checkpoint&) {}
  // The server is about to end; a session that is still open after this time will be ended, with a checkpoint.
  virtual void OnGoingAway(absl::Duration /*time_left*/) {}
  // The server was lost, why is in 'status', and the session is being resumed on this one or another.
  virtual void OnReconnecting(const absl::Status&) {}
  // It goes on; what comes next continues what came before, no final sample comes twice.
  virtual void OnResumed(const SessionAccepted&) {}
  // OK after Finish() once everything is final; otherwise why the session ended early.
  virtual void OnDone(const absl::Status& status, const SessionSummary& summary) = 0;
};

// The sending side of one session. One thread at a time may call it; Cancel may be called from any thread.
// After an error every later call returns that error; the observer's OnDone carries it too.
class TrackStream {
 public:
  // Cancels a session that is still running and blocks until OnDone has returned.
  virtual ~TrackStream() = default;
  // Blocks while the session's frame queue is full.
  virtual absl::Status PushFrame(Frame frame) = 0;
  // Queried at the newest frame pushed so far (at the first frame, when there is none yet). Ids in use are re-seeded:
  // up to the frame before, final estimates are those of the old point.
  virtual absl::Status AddPoints(std::vector<PointQuery> points) = 0;
  // After the newest frame pushed so far, up to which estimates become final. Unknown ids are ignored.
  virtual absl::Status RemovePoints(std::vector<PointId> ids) = 0;
  // No more frames: everything becomes final, then OnDone(OK). Blocks until OnDone has returned; returns its status.
  virtual absl::Status Finish() = 0;
  // Ends the session at once; OnDone(CANCELLED) follows.
  virtual void Cancel() = 0;
};

class PointTracker {
 public:
  virtual ~PointTracker() = default;
  // 'observer' is not owned and must outlive the stream.
  virtual absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) = 0;
  virtual absl::StatusOr<TrackerInfo> Info() = 0;
};

}  // namespace holdfast
