// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "holdfast/v1/point_tracking.pb.h"
#include "server/access/gatekeeper.h"
#include "server/engine/engine.h"
#include "server/events.h"
#include "server/streams/outbox.h"
#include "server/tracing/stream_trace.h"

namespace holdfast {

struct StreamOptions {
  absl::Duration first_message_timeout = absl::Seconds(10);  // until the config has come, see CheckTime
  absl::Duration idle_timeout = absl::Minutes(2);            // without a message read by either side
  int64_t max_unsent_bytes = 1 << 20;                        // of results; beyond it nothing is read from the client
  int64_t max_message_bytes = 1 << 20;                       // of one Tracks message; clients accept 4 MiB by default
};

// What carries the messages of one stream: a gRPC call, a WebSocket. Calls return at once and never call the stream
// from within; they come on any thread, with the stream's lock held.
class StreamCarrier {
 public:
  virtual ~StreamCarrier() = default;
  // One message more is wanted: OnRequest or OnInputEnd of the stream follows, or OnCancel.
  virtual void StartRead() = 0;
  // OnWritten of the stream follows, whatever becomes of the message.
  virtual void StartWrite(const v1::TrackResponse& response) = 0;
  // The last call: everything was sent that can be, and this is how the stream ends.
  virtual void Finish(const absl::Status& status) = 0;
  // Nothing more can be sent or is wanted: OnCancel of the stream follows.
  virtual void Cancel() = 0;
};

// One Track stream: hands what the client sends to an engine session and has written what comes back, one read and one
// write in flight. The carrier's events and engine calls come on any thread. Back-pressure: while the engine has no
// room, or the client leaves too many results unread, the next read is not started, so that the carrier slows the
// client. The carrier's Finish is called once, after the engine session reported its end. The destructor may block, as
// the engine session's does.
class ServedStream final : private SessionListener {
 public:
  struct Deps {
    Engine& engine;
    Clock& clock;
    ServerEvents& events;
    std::shared_ptr<spdlog::logger> log;
    StreamOptions options;
    SpanSink* spans;           // null: traces are not recorded
    absl::string_view system;  // what carries it, as traces name it: "grpc"
  };
  // 'pass' says whose stream this is and is given back at its end, 'trace' where it belongs. 'carrier' outlives the
  // stream.
  ServedStream(Deps deps, Gatekeeper::Pass pass, TraceContext trace, StreamCarrier& carrier);
  ~ServedStream() override ABSL_LOCKS_EXCLUDED(mutex_);
  // Starts the first read. Call it once, when the carrier is ready.
  void Begin() ABSL_LOCKS_EXCLUDED(mutex_);

  // Called by the owner now and then: ends a stream whose client keeps it waiting for too long. A message that does not
  // come looks like one that takes its time on a thin line, so a config has the time of the largest token besides, and
  // a frame that of the largest frame, unless the place is 'wanted' by others.
  void CheckTime(SteadyTime now, bool wanted) ABSL_LOCKS_EXCLUDED(mutex_);
  // Takes nothing more from the client and ends with 'status' once the results of what was taken are sent.
  void End(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);
  // Tells the client, once, that its session will be suspended in this time; a stream that has no session yet is told
  // by a later call.
  void GoingAway(absl::Duration time_left) ABSL_LOCKS_EXCLUDED(mutex_);
  // Takes nothing more and ends with 'status' once the session's last checkpoint is sent, and the results that it
  // counts on. A session whose client has said all finishes on another server; one that ends for a mistake goes on to
  // its end.
  void Suspend(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);
  // Ends at once.
  void Abort() ABSL_LOCKS_EXCLUDED(mutex_);

  // The carrier's events. OK or why what came is no message.
  void OnRequest(absl::StatusOr<v1::TrackRequest> request) ABSL_LOCKS_EXCLUDED(mutex_);
  void OnInputEnd() ABSL_LOCKS_EXCLUDED(mutex_);        // the client has said all
  void OnWritten(bool ok) ABSL_LOCKS_EXCLUDED(mutex_);  // not ok: nothing can be sent any more
  void OnCancel() ABSL_LOCKS_EXCLUDED(mutex_);          // the client is gone

 private:
  void OnTracks(TrackUpdate update) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnWarning(const absl::Status& warning) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnCheckpoint(Checkpoint checkpoint) override ABSL_LOCKS_EXCLUDED(mutex_);
  void OnRoomForFrame() override ABSL_LOCKS_EXCLUDED(mutex_);
  bool wants_work() const override { return trace_.recording(); }
  void OnWork(const StageWork& work) override { trace_.Add(work); }
  void OnSessionDone(const absl::Status& status, const SessionSummary& summary) override ABSL_LOCKS_EXCLUDED(mutex_);

  // The session so far; false: nothing more is taken.
  bool TakesInput(EngineSession*& session) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status Open(const v1::TrackRequest& request) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config);
  absl::Status Apply(v1::TrackRequest request, EngineSession& session) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status PushFrame(v1::Frame&& message, EngineSession& session) ABSL_LOCKS_EXCLUDED(mutex_);
  void MaybeReadLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void MaybeWriteLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool NextResponseLocked(v1::TrackResponse& response) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  v1::Checkpoint TakeCheckpointLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void AbortLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void MaybeFinishLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void TellEndLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Deps deps_;
  Gatekeeper::Pass pass_;  // leaves with the last word to the client: who hears of the end may come back at once
  const StreamTrace trace_;
  const SteadyTime started_;
  StreamCarrier& carrier_;

  // No engine method is called with mutex_ held: the engine calls the listener with its own locks held.
  absl::Mutex mutex_;
  std::shared_ptr<spdlog::logger> log_ ABSL_GUARDED_BY(mutex_);
  bool reading_ ABSL_GUARDED_BY(mutex_) = true;  // a read is in flight or being handled
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool full_ ABSL_GUARDED_BY(mutex_) = false;          // the engine has no room for a frame
  bool input_closed_ ABSL_GUARDED_BY(mutex_) = false;  // nothing more is taken from the client
  bool failing_ ABSL_GUARDED_BY(mutex_) = false;       // ...and the stream ends with an error
  bool suspended_ ABSL_GUARDED_BY(mutex_) = false;
  bool told_going_away_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;  // nothing can be sent any more
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  SteadyTime last_activity_ ABSL_GUARDED_BY(mutex_);
  std::optional<SessionAccepted> accepted_ ABSL_GUARDED_BY(mutex_);   // not sent yet
  std::optional<absl::Duration> going_away_ ABSL_GUARDED_BY(mutex_);  // not sent yet
  std::vector<absl::Status> warnings_ ABSL_GUARDED_BY(mutex_);
  Outbox outbox_ ABSL_GUARDED_BY(mutex_);
  // Not sent yet; a newer one takes its place. The results that it counts on are marked in outbox_.
  std::optional<Checkpoint> checkpoint_ ABSL_GUARDED_BY(mutex_);
  std::optional<SessionSummary> summary_ ABSL_GUARDED_BY(mutex_);  // not sent yet
  std::optional<absl::Status> done_ ABSL_GUARDED_BY(mutex_);       // how the stream ends, once that is known
  // Set once and then kept to the end. Last, so that it is destroyed first: until then the engine uses the rest.
  std::unique_ptr<EngineSession> session_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
