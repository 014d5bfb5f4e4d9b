// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/metrics.h"

namespace holdfast {

// A piece of work that the engine did for a session.
struct StageWork {
  Stage stage = Stage::kDecode;
  SteadyTime begin;
  SteadyTime end;
  int64_t first_frame = 0;  // the first one that it is about
  int64_t count = 0;        // of frames decoded or encoded, of windows refined, of points whose estimates were sent
};

// Receives what a session produces, on threads of the engine, one call at a time. Calls must return quickly and must
// not destroy the session.
class SessionListener {
 public:
  virtual ~SessionListener() = default;
  virtual void OnTracks(TrackUpdate update) = 0;
  virtual void OnWarning(const absl::Status& warning) = 0;
  // After the results that the checkpoint counts on.
  virtual void OnCheckpoint(Checkpoint checkpoint) = 0;
  // After PushFrame said "full": there is room again. May come before that PushFrame has returned.
  virtual void OnRoomForFrame() = 0;
  // Whether OnWork is worth calling; asked once, when the session begins.
  virtual bool wants_work() const { return false; }
  // What decoding, encoding, refining and sending took.
  virtual void OnWork(const StageWork& /*work*/) {}
  // The last call. OK after Finish(), otherwise why the session ended early; its earlier results came before.
  virtual void OnSessionDone(const absl::Status& status, const SessionSummary& summary) = 0;
};

enum class Room { kAvailable, kFull };

// One stream's state. Methods never block and may be called from any thread, in the order the stream has. An
// error of a method ends nothing by itself: the caller decides (a stream ends; see Fail).
class EngineSession {
 public:
  // Cancels, and blocks until the listener is not in use any more: at most as long as the batch that is being computed
  // takes. Not from a call of the listener.
  virtual ~EngineSession() = default;
  virtual const SessionAccepted& accepted() const = 0;
  // Takes the frame and says whether there is room for a next one. REQUIRES: room for this one.
  virtual absl::StatusOr<Room> PushFrame(Frame frame) = 0;
  virtual absl::Status AddPoints(const std::vector<PointQuery>& points) = 0;
  virtual absl::Status RemovePoints(const std::vector<PointId>& ids) = 0;
  // No more frames. Everything pushed so far is tracked and becomes final, then OnSessionDone(OK).
  virtual void Finish() = 0;
  // As Finish, but OnSessionDone carries 'status': nothing already pushed is lost.
  virtual void Fail(absl::Status status) = 0;
  // Takes no more input: a last checkpoint, if the session has any, then OnSessionDone(status) soon. What was pushed
  // and is not tracked yet is dropped, and nothing becomes final for it: who resumes sends it again.
  virtual void Suspend(absl::Status status) = 0;
  // OnSessionDone(CANCELLED) soon; work not yet begun is dropped.
  virtual void Cancel() = 0;
};

}  // namespace holdfast
