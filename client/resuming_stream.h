// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/point_tracker.h"
#include "api/steady_event.h"
#include "client/reconnect_plan.h"
#include "client/remote_call.h"
#include "client/send_queue.h"
#include "client/session_answers.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// One session, over one call after the other: when a call's server is lost, the session goes on with the newest
// checkpoint, or from its beginning, on the next server that takes it. Without 'resume', or with servers that make no
// checkpoints, the first call is the last.
// A thread of the stream opens calls, reads their answers and calls the observer; while a call stands, another one
// writes to it. The caller's thread meets them at the queue.
class ResumingStream final : public TrackStream {
 public:
  struct Options {
    std::vector<RemoteServer> servers;  // not empty
    size_t first_server = 0;
    absl::Duration answer_timeout;  // of one attempt, see RemoteTracker::Options
    bool resume = true;
    int64_t buffer_bytes = 0;
    absl::Duration reconnect_timeout;
    Backoff::Options backoff;
  };

  // 'observer' is not owned and must outlive the stream.
  ResumingStream(const Options& options, const SessionConfig& config, TrackObserver& observer);
  ~ResumingStream() override;

  // Blocks until a server has accepted the session, or the session is over.
  absl::Status AwaitAnswer() ABSL_LOCKS_EXCLUDED(mutex_);

  absl::Status PushFrame(Frame frame) override;
  absl::Status AddPoints(std::vector<PointQuery> points) override;
  absl::Status RemovePoints(std::vector<PointId> ids) override;
  absl::Status Finish() override ABSL_LOCKS_EXCLUDED(mutex_);
  void Cancel() override ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // A call whose server has accepted the session.
  struct OpenCall {
    std::shared_ptr<RemoteCall> call;
    SessionAccepted accepted;
  };

  // --- The stream's thread.
  void Run() ABSL_LOCKS_EXCLUDED(mutex_);
  // Until no call can follow; OK: the session has ended well.
  absl::Status RunCalls();
  absl::StatusOr<OpenCall> OpenFirst();
  absl::StatusOr<OpenCall> OpenNext(absl::Status lost);
  // For 'at_most' so long, and no longer than an answer takes.
  absl::StatusOr<OpenCall> OpenOn(size_t server, absl::Duration at_most);
  // After an error the call is over.
  absl::StatusOr<SessionAccepted> AwaitAccepted(RemoteCall& call, const v1::TrackRequest& config,
                                                absl::Duration timeout);
  v1::TrackRequest ConfigMessage() const;
  // Another server may have other defaults; the session stays what it was.
  void TakeOptions(const SessionAccepted& accepted);
  // Until the call is over; OK: and the session with it.
  absl::Status Follow(const OpenCall& open);
  absl::Status ReadAnswers(RemoteCall& call);
  absl::Status CannotGoOn(const OpenCall& open);
  bool CanResume(const absl::Status& status) const ABSL_LOCKS_EXCLUDED(mutex_);
  void SetCall(std::shared_ptr<RemoteCall> call) ABSL_LOCKS_EXCLUDED(mutex_);
  bool stopped() const ABSL_LOCKS_EXCLUDED(mutex_);
  // With the server of the moment and the newest frame in its text.
  absl::Status Located(const absl::Status& status) const;

  // --- The writer's thread.
  void WriteMessages(RemoteCall& call);

  const Options options_;
  const SystemClock clock_;
  SendQueue queue_;

  // Of the stream's thread.
  SessionConfig config_;
  SessionAnswers answers_;
  ReconnectPlan plan_;
  size_t server_ = 0;  // of the newest call

  SteadyEvent wake_;  // stopped_ was set
  mutable absl::Mutex mutex_;
  std::shared_ptr<RemoteCall> call_ ABSL_GUARDED_BY(mutex_);  // the newest
  std::optional<absl::Status> stopped_ ABSL_GUARDED_BY(mutex_);
  bool accepted_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);  // how the session ended
  bool done_ ABSL_GUARDED_BY(mutex_) = false;                // OnDone has returned

  TrackObserver& observer_;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace holdfast
