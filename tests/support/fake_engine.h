// SPDX-License-Identifier: Apache-2.0
// An Engine without a model, for tests of the server: it judges configurations and points as the real one does, and the
// content of a frame says what happens with it.
#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "api/errors.h"
#include "server/engine/engine.h"
#include "server/engine/input/point_check.h"
#include "server/engine/input/session_config.h"

namespace holdfast {

// A point moves one pixel to the right each frame. At frame i its sample of frame i - 1 becomes final and that of frame
// i is provisional. A frame of the bytes "bad" ends its session as one that does not decode, "crash" as a bug does,
// "warn" gives a warning beside its results, "checkpoint" a checkpoint behind them. All sessions share one thread.
class FakeEngine final : public Engine {
 public:
  static constexpr PointId kPaddingPoint = 1'000'000;

  struct Options {
    int max_sessions = 1000;
    int max_pending_frames = 4;
    int64_t padding_samples = 0;  // final ones of kPaddingPoint that each frame produces
  };
  FakeEngine() : FakeEngine(Options(), nullptr) {}
  explicit FakeEngine(Options options, EngineMetrics* metrics = nullptr)
      : options_(options), metrics_(metrics == nullptr ? null_metrics_ : *metrics), worker_([this] { Work(); }) {}

  ~FakeEngine() override {
    {
      absl::MutexLock lock(&mutex_);
      stopping_ = true;
    }
    worker_.join();
  }

  // Holds back everything but cancelling until Release.
  void Hold() {
    absl::MutexLock lock(&mutex_);
    held_ = true;
  }
  void Release() {
    absl::MutexLock lock(&mutex_);
    held_ = false;
  }
  int frames_taken() const {
    absl::MutexLock lock(&mutex_);
    return frames_taken_;
  }
  void AwaitFramesTaken(int count) const {
    const auto reached = [this, count]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return frames_taken_ >= count; };
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(&reached));
  }
  // By streams, before they say anything.
  void AwaitPlacesAskedFor(int count) const {
    const auto reached = [this, count]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return places_asked_for_ >= count; };
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(&reached));
  }
  int live_sessions() const {
    absl::MutexLock lock(&mutex_);
    return live_sessions_;
  }
  // Runs on the engine's thread for each frame before its results; set it before the first session.
  std::function<void(const Frame&)> on_frame;

  TrackerInfo info() const override { return info_; }
  const SessionLimits& limits() const override { return info_.limits; }

  absl::Status CheckPlaces() override {
    absl::MutexLock lock(&mutex_);
    ++places_asked_for_;
    return CheckPlacesLocked();
  }
  absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config,
                                                             SessionListener& listener) override {
    absl::MutexLock lock(&mutex_);
    absl::StatusOr<SessionAccepted> accepted = Negotiate(config, {}, {});
    if (!accepted.ok()) return accepted.status();
    if (absl::Status status = CheckPlacesLocked(); !status.ok()) return status;
    metrics_.SessionOpened();
    ++live_sessions_;
    ++admitted_;
    return std::make_unique<Session>(*this, listener, ++next_session_, config, *accepted);
  }

 private:
  class Session final : public EngineSession {
   public:
    Session(FakeEngine& engine, SessionListener& listener, int number, const SessionConfig& config,
            const SessionAccepted& accepted)
        : engine_(engine),
          listener_(listener),
          provisional_(config.send_provisional),
          accepted_(accepted),
          added_(config.points) {
      accepted_.session_id = absl::StrCat("session-", number);
      accepted_.limits = engine.info_.limits;
    }
    ~Session() override {
      engine_.Forget(this);
      if (!done_) engine_.GiveBack();
      engine_.metrics_.SessionClosed(outcome_);
    }

    const SessionAccepted& accepted() const override { return accepted_; }

    absl::StatusOr<Room> PushFrame(Frame frame) override {
      if (frame.index != next_index_) {
        return InvalidFieldError("frame.index", absl::StrCat("is ", frame.index, ", expected ", next_index_));
      }
      if (absl::Status good = CheckPoints("frame.points", frame.points, std::nullopt).ToStatus(); !good.ok()) {
        return good;
      }
      ++next_index_;
      for (const PointQuery& point : frame.points) added_.push_back(point);
      auto added = std::exchange(added_, {});
      auto shared = std::make_shared<Frame>(std::move(frame));
      return engine_.PostFrame(this, [this, shared, added = std::move(added)] { Track(*shared, added); });
    }
    absl::Status AddPoints(const std::vector<PointQuery>& points) override {
      absl::Status good = CheckPoints("add_points.points", points, std::nullopt).ToStatus();
      if (!good.ok()) return good;
      added_.insert(added_.end(), points.begin(), points.end());
      return absl::OkStatus();
    }
    absl::Status RemovePoints(const std::vector<PointId>& ids) override {
      engine_.Post(this, [this, ids] {
        for (const PointId id : ids) points_.erase(id);
      });
      return absl::OkStatus();
    }
    void Finish() override { End(absl::OkStatus()); }
    void Fail(absl::Status status) override { End(std::move(status)); }
    // The token of its checkpoint names the frame to go on with.
    void Suspend(absl::Status status) override {
      engine_.Post(this, [this, status = std::move(status)] {
        if (done_) return;
        SendCheckpoint();
        Done(status);
      });
    }
    void Cancel() override {
      engine_.PostFirst(this, [this] { Done(absl::CancelledError("cancelled")); });
    }

   private:
    friend class FakeEngine;

    void Track(const Frame& frame, const std::vector<PointQuery>& added) {
      if (done_) return;
      if (engine_.on_frame) engine_.on_frame(frame);
      if (frame.bytes == "bad") {
        return Done(InvalidFieldError("frame.data", absl::StrCat("of frame ", frame.index, " does not decode")));
      }
      if (frame.bytes == "crash") return Done(absl::InternalError("assertion failed in /usr/src/secret/file.cc"));
      if (frame.bytes == "warn") listener_.OnWarning(absl::UnavailableError("degraded"));
      for (const PointQuery& point : added) points_[point.id] = {point, frame.index};
      frames_ = frame.index + 1;
      if (listener_.wants_work()) listener_.OnWork({Stage::kRefine, {}, {}, frame.index, 1});
      Emit(/*last=*/false);
      if (frame.bytes == "checkpoint") SendCheckpoint();
      engine_.metrics_.FrameDone(FrameResult::kTracked);
    }

    void SendCheckpoint() { listener_.OnCheckpoint({absl::StrCat("token-", frames_), frames_, true}); }

    void Emit(bool last) {
      TrackUpdate update;
      update.frames_received = update.frames_processed = frames_;
      for (const auto& [id, point] : points_) {
        PointRun run = Samples(point.first, std::max(point.second, frames_ - (last ? 1 : 2)), frames_);
        run.final_count = static_cast<int64_t>(run.x.size()) - (last ? 0 : 1);
        if (!provisional_ && !last) Shorten(run);
        if (!run.x.empty()) update.runs.push_back(std::move(run));
      }
      if (engine_.options_.padding_samples > 0 && !last) update.runs.push_back(Padding());
      for (const PointRun& run : update.runs) final_samples_ += run.final_count;
      listener_.OnTracks(std::move(update));
    }

    static PointRun Samples(const PointQuery& point, int64_t begin, int64_t end) {
      PointRun run;
      run.id = point.id;
      run.first_frame = begin;
      for (int64_t frame = begin; frame < end; ++frame) {
        run.x.push_back(point.x + static_cast<float>(frame));
        run.y.push_back(point.y);
        run.visible.push_back(1);
        run.confidence.push_back(0.5F);
      }
      return run;
    }
    static void Shorten(PointRun& run) {
      run.x.pop_back();
      run.y.pop_back();
      run.visible.pop_back();
      run.confidence.pop_back();
    }
    PointRun Padding() const {
      const int64_t samples = engine_.options_.padding_samples;
      PointRun run = Samples({kPaddingPoint, 0, 0}, (frames_ - 1) * samples, frames_ * samples);
      run.final_count = samples;
      return run;
    }

    void End(absl::Status status) {
      engine_.Post(this, [this, status = std::move(status)] {
        if (done_) return;
        if (frames_ > 0) Emit(/*last=*/true);
        Done(status);
      });
    }

    void Done(const absl::Status& status) {
      if (std::exchange(done_, true)) return;
      engine_.GiveBack();  // before OnSessionDone: who hears of the end may come back at once
      outcome_ = status.ok()                 ? SessionOutcome::kCompleted
                 : absl::IsCancelled(status) ? SessionOutcome::kCancelled
                                             : SessionOutcome::kFailed;
      listener_.OnSessionDone(status, {frames_, static_cast<int64_t>(points_.size()), final_samples_});
    }

    FakeEngine& engine_;
    SessionListener& listener_;
    const bool provisional_;
    SessionAccepted accepted_;
    // Of the caller.
    std::vector<PointQuery> added_;
    int64_t next_index_ = 0;
    // Of the engine's thread.
    std::map<PointId, std::pair<PointQuery, int64_t>> points_;  // with the frame of the query
    int64_t frames_ = 0;
    int64_t final_samples_ = 0;
    bool done_ = false;
    SessionOutcome outcome_ = SessionOutcome::kCancelled;
    int pending_ = 0;  // guarded by the engine's mutex
  };

  absl::Status CheckPlacesLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (admitted_ < options_.max_sessions) return absl::OkStatus();
    metrics_.AdmissionRejected(RejectReason::kSessions);
    return OverloadError("sessions", "all are open", absl::Milliseconds(2500));
  }

  struct Task {
    Session* session;
    std::function<void()> run;
    bool is_frame;
    bool urgent;
  };

  Room PostFrame(Session* session, std::function<void()> run) {
    absl::MutexLock lock(&mutex_);
    ++frames_taken_;
    tasks_.push_back({session, std::move(run), true, false});
    return ++session->pending_ < options_.max_pending_frames ? Room::kAvailable : Room::kFull;
  }
  void Post(Session* session, std::function<void()> run) {
    absl::MutexLock lock(&mutex_);
    tasks_.push_back({session, std::move(run), false, false});
  }
  void PostFirst(Session* session, std::function<void()> run) {
    absl::MutexLock lock(&mutex_);
    tasks_.push_front({session, std::move(run), false, true});
  }
  void GiveBack() {
    absl::MutexLock lock(&mutex_);
    --admitted_;
  }
  // Blocks until the session is not in use.
  void Forget(Session* session) {
    absl::MutexLock lock(&mutex_);
    tasks_.erase(std::remove_if(tasks_.begin(), tasks_.end(), [&](const Task& t) { return t.session == session; }),
                 tasks_.end());
    const auto unused = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return running_ != session; };
    mutex_.Await(absl::Condition(&unused));
    --live_sessions_;
  }

  bool MayRun() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return stopping_ || (!tasks_.empty() && (!held_ || tasks_.front().urgent));
  }

  void Work() {
    absl::MutexLock lock(&mutex_);
    while (true) {
      mutex_.Await(absl::Condition(this, &FakeEngine::MayRun));
      if (stopping_) return;
      const Task task = std::move(tasks_.front());
      tasks_.pop_front();
      running_ = task.session;
      mutex_.Unlock();
      task.run();
      mutex_.Lock();
      if (task.is_frame && task.session->pending_-- == options_.max_pending_frames) {
        mutex_.Unlock();
        if (!task.session->done_) task.session->listener_.OnRoomForFrame();
        mutex_.Lock();
      }
      running_ = nullptr;
    }
  }

  static TrackerInfo FakeInfo() {
    TrackerInfo info;
    info.model_name = "fake";
    info.preset = "none";
    info.weights_sha256 = std::string(64, 'a');
    info.precision = "float32";
    info.device = "cpu";
    info.build = "test";
    info.default_processing_size = {512, 384};
    info.window_frames = 24;
    info.default_hop_frames = 8;
    info.default_iterations = 4;
    info.max_sessions = 1000;
    info.limits = {2048, 16 << 20, 3840 * 2160, 0};
    return info;
  }

  const Options options_;
  NullEngineMetrics null_metrics_;
  EngineMetrics& metrics_;
  const TrackerInfo info_ = FakeInfo();

  mutable absl::Mutex mutex_;
  std::deque<Task> tasks_ ABSL_GUARDED_BY(mutex_);
  Session* running_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool held_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  int places_asked_for_ ABSL_GUARDED_BY(mutex_) = 0;
  int frames_taken_ ABSL_GUARDED_BY(mutex_) = 0;
  int live_sessions_ ABSL_GUARDED_BY(mutex_) = 0;  // not destroyed
  int admitted_ ABSL_GUARDED_BY(mutex_) = 0;       // not done
  int next_session_ ABSL_GUARDED_BY(mutex_) = 0;
  std::thread worker_;
};

}  // namespace holdfast
