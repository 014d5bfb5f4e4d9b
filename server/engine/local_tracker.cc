// SPDX-License-Identifier: Apache-2.0
#include "server/engine/local_tracker.h"

#include <deque>
#include <functional>
#include <optional>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {
namespace {

// Updates that may wait for a slow observer before frames stop being taken.
constexpr size_t kMaxWaitingEvents = 16;

// A session and a thread of its own that calls the observer, so that the observer may take its time.
class LocalStream final : public TrackStream, private SessionListener {
 public:
  explicit LocalStream(TrackObserver& observer) : observer_(observer) {}

  ~LocalStream() override {
    session_.reset();  // OnSessionDone has come when this returns
    if (thread_.joinable()) thread_.join();
  }

  absl::Status Open(Engine& engine, const SessionConfig& config) {
    auto session = engine.OpenSession(config, *this);
    if (!session.ok()) return session.status();
    session_ = *std::move(session);
    thread_ = std::thread([this, accepted = session_->accepted()] { Run(accepted); });
    return absl::OkStatus();
  }

  absl::Status PushFrame(Frame frame) override {
    if (absl::Status status = AwaitRoom(); !status.ok()) return status;
    const absl::StatusOr<Room> room = session_->PushFrame(std::move(frame));
    if (!room.ok()) return Failed(room.status());
    if (*room == Room::kAvailable) OnRoomForFrame();
    return absl::OkStatus();
  }

  absl::Status AddPoints(std::vector<PointQuery> points) override { return Failed(session_->AddPoints(points)); }
  absl::Status RemovePoints(std::vector<PointId> ids) override { return Failed(session_->RemovePoints(ids)); }

  absl::Status Finish() override {
    session_->Finish();
    absl::MutexLock lock(&mutex_);
    while (!told_done_) changed_.Wait(&mutex_);
    return *done_;
  }

  void Cancel() override { session_->Cancel(); }

 private:
  using Event = std::function<void(TrackObserver&)>;

  // Takes the room: it is there again when the session says so.
  absl::Status AwaitRoom() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!done_ && (!room_ || events_.size() >= kMaxWaitingEvents)) changed_.Wait(&mutex_);
    if (done_) return done_->ok() ? absl::FailedPreconditionError("the stream has finished") : *done_;
    room_ = false;
    return absl::OkStatus();
  }

  // An error of the session ends it; what it has taken before is still tracked.
  absl::Status Failed(absl::Status status) {
    if (!status.ok()) {
      session_->Fail(status);
      OnRoomForFrame();  // the next PushFrame is to hear of the error, not to wait
    }
    return status;
  }

  void OnTracks(TrackUpdate update) override {
    Enqueue([update = std::move(update)](TrackObserver& observer) mutable { observer.OnTracks(std::move(update)); });
  }
  void OnWarning(const absl::Status& warning) override {
    Enqueue([warning](TrackObserver& observer) { observer.OnWarning(warning); });
  }
  void OnCheckpoint(Checkpoint checkpoint) override {
    Enqueue([checkpoint = std::move(checkpoint)](TrackObserver& observer) { observer.OnCheckpoint(checkpoint); });
  }
  void OnRoomForFrame() override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    room_ = true;
    changed_.SignalAll();
  }
  void OnSessionDone(const absl::Status& status, const SessionSummary& summary) override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    done_ = status;
    events_.push_back([status, summary](TrackObserver& observer) { observer.OnDone(status, summary); });
    changed_.SignalAll();
  }

  void Enqueue(Event event) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    events_.push_back(std::move(event));
    changed_.SignalAll();
  }

  void Run(const SessionAccepted& accepted) ABSL_LOCKS_EXCLUDED(mutex_) {
    observer_.OnAccepted(accepted);
    while (true) {
      Event event;
      bool last = false;
      {
        absl::MutexLock lock(&mutex_);
        while (events_.empty()) changed_.Wait(&mutex_);
        event = std::move(events_.front());
        events_.pop_front();
        last = done_ && events_.empty();  // OnDone is the last event
        changed_.SignalAll();
      }
      event(observer_);
      if (!last) continue;
      absl::MutexLock lock(&mutex_);
      told_done_ = true;
      changed_.SignalAll();
      return;
    }
  }

  TrackObserver& observer_;
  std::unique_ptr<EngineSession> session_;
  absl::Mutex mutex_;
  absl::CondVar changed_;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);
  bool room_ ABSL_GUARDED_BY(mutex_) = true;
  std::optional<absl::Status> done_ ABSL_GUARDED_BY(mutex_);
  bool told_done_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<TrackStream>> LocalTracker::Open(const SessionConfig& config, TrackObserver& observer) {
  auto stream = std::make_unique<LocalStream>(observer);
  if (absl::Status status = stream->Open(engine_, config); !status.ok()) {
    observer.OnDone(status, {});
    return status;
  }
  return stream;
}

absl::StatusOr<TrackerInfo> LocalTracker::Info() { return engine_.info(); }

}  // namespace holdfast
