// SPDX-License-Identifier: Apache-2.0
// What sessions, streams and metrics were told, for tests to look at. Thread-safe.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/point_tracker.h"
#include "api/types.h"
#include "server/engine/engine.h"
#include "server/engine/metrics.h"

namespace holdfast {

// The final estimates of one point by frame.
struct FinalSample {
  float x = 0;
  float y = 0;
  bool visible = false;
  float confidence = 0;
  friend bool operator==(const FinalSample& a, const FinalSample& b) {
    return a.x == b.x && a.y == b.y && a.visible == b.visible && a.confidence == b.confidence;
  }
};
using FinalTrack = std::map<int64_t, FinalSample>;
using FinalObject = std::map<int64_t, ObjectSample>;

inline bool SameObjectSamples(const ObjectSample& a, const ObjectSample& b) {
  const auto same = [](Pixel p, Pixel q) { return p.x == q.x && p.y == q.y; };
  return same(a.centre, b.centre) && a.scale == b.scale && a.rotation == b.rotation && a.visible == b.visible &&
         a.left == b.left && a.joined == b.joined &&
         std::equal(a.outline.begin(), a.outline.end(), b.outline.begin(), b.outline.end(), same);
}

// Updates, and how the session ended. Checks that runs are well-formed and that a point's runs follow each other:
// every frame becomes final at most once.
class UpdateRecorder {
 public:
  void Add(TrackUpdate update) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    EXPECT_FALSE(done_) << "an update after the end";
    for (const PointRun& run : update.runs) AddRunLocked(run);
    for (const ObjectRun& run : update.objects) AddRunLocked(run);
    updates_.push_back(std::move(update));
    changed_.SignalAll();
  }
  void Add(const Checkpoint& checkpoint) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    EXPECT_FALSE(done_) << "a checkpoint after the end";
    checkpoints_.push_back(checkpoint);
    changed_.SignalAll();
  }
  void Done(const absl::Status& status, const SessionSummary& summary) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    EXPECT_FALSE(done_) << "ended twice";
    done_ = status;
    summary_ = summary;
    changed_.SignalAll();
  }

  absl::Status AwaitDone() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!done_) changed_.Wait(&mutex_);
    return *done_;
  }
  // Until 'count' frames of the point are final.
  void AwaitFinal(PointId id, size_t count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!done_ && finals_[id].size() < count) changed_.Wait(&mutex_);
  }
  void AwaitUpdates(size_t count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!done_ && updates_.size() < count) changed_.Wait(&mutex_);
  }
  void AwaitCheckpoints(size_t count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!done_ && checkpoints_.size() < count) changed_.Wait(&mutex_);
  }
  bool done() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return done_.has_value();
  }
  SessionSummary summary() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return summary_;
  }
  FinalTrack Final(PointId id) const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    const auto it = finals_.find(id);
    return it == finals_.end() ? FinalTrack() : it->second;
  }
  std::map<PointId, FinalTrack> Finals() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return finals_;
  }
  FinalObject FinalOfObject(ObjectId id) const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    const auto it = final_objects_.find(id);
    return it == final_objects_.end() ? FinalObject() : it->second;
  }
  std::vector<TrackUpdate> updates() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return updates_;
  }
  std::vector<Checkpoint> checkpoints() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return checkpoints_;
  }

 private:
  void AddRunLocked(const PointRun& run) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    EXPECT_EQ(run.x.size(), run.y.size());
    EXPECT_EQ(run.x.size(), run.visible.size());
    EXPECT_EQ(run.x.size(), run.confidence.size());
    EXPECT_LE(run.final_count, static_cast<int64_t>(run.x.size()));
    EXPECT_FALSE(run.x.empty());
    FinalTrack& track = finals_[run.id];
    if (!track.empty()) {
      EXPECT_GE(run.first_frame, track.rbegin()->first + 1);  // more than that only after re-seeding
    }
    for (int64_t i = 0; i < run.final_count; ++i) {
      track[run.first_frame + i] = {run.x[i], run.y[i], run.visible[i] != 0, run.confidence[i]};
    }
  }

  void AddRunLocked(const ObjectRun& run) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    EXPECT_FALSE(run.samples.empty());
    EXPECT_LE(run.final_count, static_cast<int64_t>(run.samples.size()));
    FinalObject& object = final_objects_[run.id];
    if (!object.empty()) {
      EXPECT_GE(run.first_frame, object.rbegin()->first + 1);
    }
    for (int64_t i = 0; i < run.final_count; ++i) object[run.first_frame + i] = run.samples[i];
  }

  mutable absl::Mutex mutex_;
  absl::CondVar changed_;
  std::vector<TrackUpdate> updates_ ABSL_GUARDED_BY(mutex_);
  std::map<PointId, FinalTrack> finals_ ABSL_GUARDED_BY(mutex_);
  std::map<ObjectId, FinalObject> final_objects_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Status> done_ ABSL_GUARDED_BY(mutex_);
  SessionSummary summary_ ABSL_GUARDED_BY(mutex_);
  std::vector<Checkpoint> checkpoints_ ABSL_GUARDED_BY(mutex_);
};

// Pushes frames as the session has room for them. Asks for the engine's work when it is told to before the session.
class RecordingListener final : public SessionListener, public UpdateRecorder {
 public:
  void OnTracks(TrackUpdate update) override { Add(std::move(update)); }
  void OnWarning(const absl::Status&) override {}
  void OnCheckpoint(Checkpoint checkpoint) override { Add(checkpoint); }
  void OnRoomForFrame() override ABSL_LOCKS_EXCLUDED(room_mutex_) {
    absl::MutexLock lock(&room_mutex_);
    room_ = true;
    room_changed_.SignalAll();
  }
  bool wants_work() const override { return want_work; }
  void OnWork(const StageWork& work) override ABSL_LOCKS_EXCLUDED(room_mutex_) {
    EXPECT_FALSE(done()) << "work after the end";
    absl::MutexLock lock(&room_mutex_);
    work_.push_back(work);
  }
  std::vector<StageWork> work() const ABSL_LOCKS_EXCLUDED(room_mutex_) {
    absl::MutexLock lock(&room_mutex_);
    return work_;
  }
  bool want_work = false;

  void OnSessionDone(const absl::Status& status, const SessionSummary& summary) override {
    Done(status, summary);
    OnRoomForFrame();
  }
  // Waits for room first.
  absl::StatusOr<Room> Push(EngineSession& session, Frame frame) ABSL_LOCKS_EXCLUDED(room_mutex_) {
    {
      absl::MutexLock lock(&room_mutex_);
      while (!room_) room_changed_.Wait(&room_mutex_);
      room_ = false;
    }
    const absl::StatusOr<Room> room = session.PushFrame(std::move(frame));
    if (!room.ok() || *room == Room::kAvailable) OnRoomForFrame();
    return room;
  }

 private:
  mutable absl::Mutex room_mutex_;
  std::vector<StageWork> work_ ABSL_GUARDED_BY(room_mutex_);
  absl::CondVar room_changed_;
  bool room_ ABSL_GUARDED_BY(room_mutex_) = true;
};

class RecordingObserver final : public TrackObserver, public UpdateRecorder {
 public:
  void OnAccepted(const SessionAccepted& accepted) override { accepted_ = accepted; }
  void OnTracks(TrackUpdate update) override { Add(std::move(update)); }
  void OnCheckpoint(const Checkpoint& checkpoint) override { Add(checkpoint); }
  void OnGoingAway(absl::Duration) override ABSL_LOCKS_EXCLUDED(moves_mutex_) {
    absl::MutexLock lock(&moves_mutex_);
    ++going_away_;
  }
  void OnResumed(const SessionAccepted&) override ABSL_LOCKS_EXCLUDED(moves_mutex_) {
    absl::MutexLock lock(&moves_mutex_);
    ++resumed_;
    moved_.SignalAll();
  }
  void OnDone(const absl::Status& status, const SessionSummary& summary) override { Done(status, summary); }

  void AwaitResumed(int count) ABSL_LOCKS_EXCLUDED(moves_mutex_) {
    absl::MutexLock lock(&moves_mutex_);
    while (resumed_ < count) moved_.Wait(&moves_mutex_);
  }
  int resumed() const ABSL_LOCKS_EXCLUDED(moves_mutex_) {
    absl::MutexLock lock(&moves_mutex_);
    return resumed_;
  }
  int going_away() const ABSL_LOCKS_EXCLUDED(moves_mutex_) {
    absl::MutexLock lock(&moves_mutex_);
    return going_away_;
  }
  // REQUIRES: the session is done.
  const std::optional<SessionAccepted>& accepted() const { return accepted_; }

 private:
  std::optional<SessionAccepted> accepted_;
  mutable absl::Mutex moves_mutex_;
  absl::CondVar moved_;
  int resumed_ ABSL_GUARDED_BY(moves_mutex_) = 0;
  int going_away_ ABSL_GUARDED_BY(moves_mutex_) = 0;
};

class RecordingMetrics final : public EngineMetrics {
 public:
  struct Totals {
    int64_t opened = 0;
    std::map<RejectReason, int64_t> rejected;
    std::map<SessionOutcome, int64_t> closed;
    std::map<FrameResult, int64_t> frames;
    std::map<Stage, int64_t> stages;
    int64_t points = 0, rows = 0, batches = 0, max_batch_rows = 0, iterations = 0;
    int64_t cache_bytes = 0, max_cache_bytes = 0;
    absl::Duration shortest_stage = absl::InfiniteDuration(), longest_stage;
    std::vector<absl::Duration> first, final;
    std::vector<int64_t> lags;
    double work_budget = 0, work_promised = 0;
    std::vector<ImageSize> fell_back;
  };
  Totals totals() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return totals_;
  }

  // Until 'stage' was told of 'count' times.
  void AwaitStage(Stage stage, int64_t count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (totals_.stages[stage] < count) changed_.Wait(&mutex_);
  }

  void SessionOpened() override {
    Update([](Totals& t) { ++t.opened; });
  }
  void SessionClosed(SessionOutcome outcome) override {
    Update([=](Totals& t) { ++t.closed[outcome]; });
  }
  void AdmissionRejected(RejectReason reason) override {
    Update([=](Totals& t) { ++t.rejected[reason]; });
  }
  void PointsActive(int64_t delta) override {
    Update([=](Totals& t) { t.points += delta; });
  }
  void FrameDone(FrameResult result) override {
    Update([=](Totals& t) { ++t.frames[result]; });
  }
  void StageTook(Stage stage, absl::Duration took) override {
    Update([=](Totals& t) {
      ++t.stages[stage];
      t.shortest_stage = std::min(t.shortest_stage, took);
      t.longest_stage = std::max(t.longest_stage, took);
    });
  }
  void FirstEstimate(absl::Duration since_arrival) override {
    Update([=](Totals& t) { t.first.push_back(since_arrival); });
  }
  void FinalEstimate(absl::Duration since_arrival) override {
    Update([=](Totals& t) { t.final.push_back(since_arrival); });
  }
  void SessionLag(int64_t frames) override {
    Update([=](Totals& t) { t.lags.push_back(frames); });
  }
  void BatchRefined(absl::Span<const int> iterations) override {
    const auto rows = static_cast<int64_t>(iterations.size());
    Update([=](Totals& t) {
      ++t.batches;
      t.rows += rows;
      t.max_batch_rows = std::max(t.max_batch_rows, rows);
      for (const int taken : iterations) t.iterations += taken;
    });
  }
  void CacheBytes(int64_t bytes) override {
    Update([=](Totals& t) {
      t.cache_bytes = bytes;
      t.max_cache_bytes = std::max(t.max_cache_bytes, bytes);
    });
  }
  void WorkBudget(double work) override {
    Update([=](Totals& t) { t.work_budget = work; });
  }
  void WorkPromised(double work) override {
    Update([=](Totals& t) { t.work_promised = work; });
  }
  void PrecisionFellBack(ImageSize size, absl::string_view) override {
    Update([=](Totals& t) { t.fell_back.push_back(size); });
  }

 private:
  template <typename Change>
  void Update(Change change) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    change(totals_);
    changed_.SignalAll();
  }
  mutable absl::Mutex mutex_;
  absl::CondVar changed_;
  Totals totals_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
