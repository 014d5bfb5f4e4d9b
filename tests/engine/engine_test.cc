// SPDX-License-Identifier: Apache-2.0
// The engine with its threads, over a network whose answers are known.
#include "server/engine/engine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <memory>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "proto/errors.h"
#include "server/engine/batcher.h"
#include "server/engine/engine_with_model.h"
#include "tests/support/fake_tracker_model.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::Gt;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Le;
using ::testing::SizeIs;

// Holds back who passes until it is opened.
class Gate {
 public:
  void Pass() {
    absl::MutexLock lock(&mutex_);
    ++waiting_;
    changed_.SignalAll();
    while (!open_) changed_.Wait(&mutex_);
  }
  void AwaitWaiting() {
    absl::MutexLock lock(&mutex_);
    while (waiting_ == 0) changed_.Wait(&mutex_);
  }
  void Open() {
    absl::MutexLock lock(&mutex_);
    open_ = true;
    changed_.SignalAll();
  }

 private:
  absl::Mutex mutex_;
  absl::CondVar changed_;
  bool open_ ABSL_GUARDED_BY(mutex_) = false;
  int waiting_ ABSL_GUARDED_BY(mutex_) = 0;
};

constexpr ImageSize kFrame{64, 32};

SessionConfig Config(std::vector<PointQuery> points = {}, int hop = 8) {
  SessionConfig config;
  config.encoding = FrameEncoding::kGray8;
  config.raw_size = kFrame;
  config.processing_size = kFrame;
  config.hop_frames = hop;
  config.points = std::move(points);
  return config;
}

Frame MakeFrame(int64_t index, std::vector<PointQuery> points = {}) {
  return {index, std::string(kFrame.width * kFrame.height, static_cast<char>(index % 251)), {}, std::move(points)};
}

class EngineTest : public ::testing::Test {
 protected:
  EngineTest() : model_(new FakeTrackerModel), counts_(model_->counts()) { options_.decode_threads = 2; }

  // Before it: options_ and *model_ may be changed.
  Engine& engine() {
    if (!engine_) {
      auto engine = CreateEngineWithModel(options_, std::unique_ptr<TrackerModel>(model_), clock_, metrics_);
      EXPECT_THAT(engine, IsOk());
      engine_ = *std::move(engine);
    }
    return *engine_;
  }
  std::unique_ptr<EngineSession> Open(const SessionConfig& config, RecordingListener& listener) {
    auto session = engine().OpenSession(config, listener);
    EXPECT_THAT(session, IsOk());
    return *std::move(session);
  }
  static void PushFrames(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) ASSERT_THAT(listener.Push(session, MakeFrame(i)), IsOk());
  }

  EngineOptions options_;
  SimulatedClock clock_;
  RecordingMetrics metrics_;
  FakeTrackerModel* model_;  // the engine's, once there is one
  std::shared_ptr<const FakeTrackerModel::Counts> counts_;
  std::unique_ptr<Engine> engine_;
};

TEST_F(EngineTest, TracksAClipFromTheFirstFrameToTheLast) {
  RecordingListener listener;
  auto session = Open(Config({{7, 10, 20}}), listener);
  PushFrames(*session, listener, 0, 50);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  const FinalTrack track = listener.Final(7);
  ASSERT_THAT(track, SizeIs(50));
  for (const auto& [frame, sample] : track) {
    EXPECT_FLOAT_EQ(sample.x, 10 + 4.0f * frame);
    EXPECT_EQ(sample.y, 20);
    EXPECT_EQ(sample.visible, sample.x < 63.5f);
  }
  EXPECT_EQ(listener.summary().frames, 50);
  EXPECT_EQ(listener.summary().points, 1);
  EXPECT_EQ(listener.summary().final_samples, 50);
}

TEST_F(EngineTest, EncodesEveryFrameOnceWhateverThePointsAndWindows) {
  RecordingListener listener;
  std::vector<PointQuery> points;
  for (PointId id = 0; id < 100; ++id) points.push_back({id, 1, 1});
  auto session = Open(Config(points, /*hop=*/1), listener);
  PushFrames(*session, listener, 0, 60);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(counts_->frames, 60);
  EXPECT_THAT(counts_->rows, Gt(100 * 37));
  EXPECT_THAT(listener.Final(99), SizeIs(60));
}

TEST_F(EngineTest, MemoryAfter2000FramesIsThatAfter200) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
  PushFrames(*session, listener, 0, 200);
  listener.AwaitFinal(1, 170);
  // What was cached may be up to what the session was admitted with; never more.
  const int64_t admitted = 24 + 8 + options_.max_pending_frames;
  EXPECT_LE(counts_->max_alive, admitted + options_.max_batch_frames);
  PushFrames(*session, listener, 200, 2000);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_LE(counts_->max_alive, admitted + options_.max_batch_frames);
  EXPECT_LE(metrics_.totals().max_cache_bytes, admitted * FakeTrackerModel::kFrameBytes);
  EXPECT_EQ(counts_->alive, 0);
  EXPECT_THAT(listener.Final(2), SizeIs(2000));
}

TEST_F(EngineTest, APointDoesNotDependOnOthersNorOnHowItCame) {
  RecordingListener alone, crowd;
  {
    auto session = Open(Config({}), alone);
    PushFrames(*session, alone, 0, 10);
    ASSERT_THAT(alone.Push(*session, MakeFrame(10, {{5, 30, 10}})), IsOk());
    PushFrames(*session, alone, 11, 60);
    session->Finish();
    EXPECT_THAT(alone.AwaitDone(), IsOk());
  }
  std::vector<PointQuery> points;
  for (PointId id = 100; id < 150; ++id) points.push_back({id, 3, 3});
  auto session = Open(Config(points), crowd);
  PushFrames(*session, crowd, 0, 11);
  ASSERT_THAT(session->AddPoints({{5, 30, 10}}), IsOk());
  ASSERT_THAT(session->RemovePoints({100, 101}), IsOk());
  PushFrames(*session, crowd, 11, 60);
  session->Finish();
  EXPECT_THAT(crowd.AwaitDone(), IsOk());
  EXPECT_THAT(crowd.Final(5), SizeIs(50));
  EXPECT_EQ(crowd.Final(5), alone.Final(5));
}

TEST_F(EngineTest, SendsProvisionalEstimatesOnlyToWhoWantsThem) {
  RecordingListener with, without;
  SessionConfig config = Config({{1, 1, 1}});
  auto first = Open(config, with);
  config.send_provisional = false;
  auto second = Open(config, without);
  for (auto* pair : {&with, &without}) {
    auto& session = pair == &with ? *first : *second;
    PushFrames(session, *pair, 0, 40);
    session.Finish();
    EXPECT_THAT(pair->AwaitDone(), IsOk());
  }
  bool provisional = false;
  for (const TrackUpdate& update : with.updates()) {
    for (const PointRun& run : update.runs) provisional |= run.final_count < static_cast<int64_t>(run.x.size());
  }
  EXPECT_TRUE(provisional);
  for (const TrackUpdate& update : without.updates()) {
    for (const PointRun& run : update.runs) EXPECT_EQ(run.final_count, static_cast<int64_t>(run.x.size()));
  }
  EXPECT_EQ(with.Final(1), without.Final(1));
}

TEST_F(EngineTest, GivesAnEarlyEstimateBeforeTheWindowIsFull) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 8);
  listener.AwaitUpdates(1);
  const TrackUpdate update = listener.updates().at(0);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_EQ(update.runs[0].final_count, 1);
  EXPECT_THAT(update.runs[0].x, SizeIs(8));
  EXPECT_EQ(update.frames_received, 8);
  EXPECT_EQ(update.frames_processed, 8);
}

TEST_F(EngineTest, RefusesFramesWithoutRoomAndSaysWhenThereIsRoomAgain) {
  Gate gate;
  model_->before_encode = [&gate] { gate.Pass(); };
  options_.max_pending_frames = 2;
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  EXPECT_THAT(listener.Push(*session, MakeFrame(0)), IsOkAndHolds(Room::kAvailable));
  gate.AwaitWaiting();  // frame 0 is being encoded
  EXPECT_THAT(listener.Push(*session, MakeFrame(1)), IsOkAndHolds(Room::kAvailable));
  EXPECT_THAT(listener.Push(*session, MakeFrame(2)), IsOkAndHolds(Room::kFull));
  EXPECT_THAT(session->PushFrame(MakeFrame(3)), StatusIs(absl::StatusCode::kFailedPrecondition));
  gate.Open();
  ASSERT_THAT(listener.Push(*session, MakeFrame(3)), IsOk());
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_THAT(listener.Final(1), SizeIs(4));
}

std::string Jpeg() {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(kFrame.height, kFrame.width, CV_8UC3, cv::Scalar(9, 9, 9)), bytes);
  return {bytes.begin(), bytes.end()};
}

TEST_F(EngineTest, ABadFrameKeepsTheResultsOfTheFramesBeforeIt) {
  RecordingListener listener;
  SessionConfig config = Config({{1, 1, 1}});
  config.encoding = FrameEncoding::kJpeg;
  config.raw_size = {};
  auto session = Open(config, listener);
  for (int64_t i = 0; i < 30; ++i) ASSERT_THAT(listener.Push(*session, {i, Jpeg()}), IsOk());
  // A header that is right, and nothing that could be decoded behind it: found out by the decode pool.
  const std::string bad("\xFF\xD8\xFF\xC0\x00\x0B\x08\x00\x20\x00\x40\x01\x01\x11\x00\xFF\xDA\xFF\xD9", 19);
  ASSERT_THAT(listener.Push(*session, {30, bad}), IsOk());
  const absl::Status status = listener.AwaitDone();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame 30")));
  EXPECT_THAT(listener.Final(1), SizeIs(30));
  EXPECT_EQ(session->PushFrame({31, Jpeg()}).status(), status);
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kFailed], 1);
}

TEST_F(EngineTest, FailingTracksWhatCameBeforeToTheEnd) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 30);
  const absl::Status wrong = listener.Push(*session, {30, "short"}).status();
  EXPECT_THAT(wrong, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame 30: 5 bytes, expected 2048")));
  session->Fail(wrong);
  EXPECT_EQ(listener.AwaitDone(), wrong);
  EXPECT_THAT(listener.Final(1), SizeIs(30));
  EXPECT_EQ(metrics_.totals().frames[FrameResult::kRejected], 1);
}

TEST_F(EngineTest, CancellingDropsWhatWasNotBegun) {
  Gate gate;
  model_->before_encode = [&gate] { gate.Pass(); };
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  ASSERT_THAT(session->PushFrame(MakeFrame(0)), IsOk());
  gate.AwaitWaiting();
  ASSERT_THAT(session->PushFrame(MakeFrame(1)), IsOk());
  session->Cancel();
  gate.Open();
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_EQ(counts_->frames, 1);
  EXPECT_THAT(session->PushFrame(MakeFrame(2)), StatusIs(absl::StatusCode::kCancelled));
  session.reset();
  EXPECT_EQ(metrics_.totals().frames[FrameResult::kDropped], 1);
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kCancelled], 1);
  EXPECT_EQ(metrics_.totals().points, 0);
}

TEST_F(EngineTest, ASessionMayBeDestroyedAtAnyMoment) {
  for (int64_t frames = 0; frames < 60; ++frames) {
    RecordingListener listener;
    auto session = Open(Config({{1, 1, 1}}, 1 + frames % 23), listener);
    PushFrames(*session, listener, 0, frames);
    if (frames % 2 == 0) session->Finish();
    session.reset();
    EXPECT_TRUE(listener.done());
  }
  EXPECT_EQ(counts_->alive, 0);
}

TEST_F(EngineTest, RemovedAndReSeededPointsEndAndStartWhereTheyShould) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
  PushFrames(*session, listener, 0, 25);
  ASSERT_THAT(session->RemovePoints({1}), IsOk());
  PushFrames(*session, listener, 25, 40);
  ASSERT_THAT(listener.Push(*session, MakeFrame(40, {{2, 40, 2}, {1, 20, 5}})), IsOk());
  PushFrames(*session, listener, 41, 70);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  const FinalTrack removed = listener.Final(1), seeded = listener.Final(2);
  EXPECT_EQ(removed.count(23), 1u);
  EXPECT_EQ(removed.count(24), 0u);  // no estimate by frame 24, where it was removed
  EXPECT_EQ(removed.count(39), 0u);
  EXPECT_EQ(removed.at(40).x, 20);
  EXPECT_FLOAT_EQ(seeded.at(39).x, 2 + 39 * 4);
  EXPECT_EQ(seeded.at(40).x, 40);
  EXPECT_FLOAT_EQ(seeded.at(69).x, 40 + 29 * 4);
  EXPECT_EQ(listener.summary().points, 4);
}

TEST_F(EngineTest, SessionsOfDifferentSizesShareTheEngine) {
  RecordingListener small, large;
  auto first = Open(Config({{1, 1, 1}}), small);
  SessionConfig config = Config({{1, 1, 1}});
  config.processing_size = {128, 64};
  auto second = Open(config, large);
  for (int64_t i = 0; i < 40; ++i) {
    PushFrames(*first, small, i, i + 1);
    PushFrames(*second, large, i, i + 1);
  }
  first->Finish();
  second->Finish();
  EXPECT_THAT(small.AwaitDone(), IsOk());
  EXPECT_THAT(large.AwaitDone(), IsOk());
  EXPECT_FLOAT_EQ(small.Final(1).at(39).x, 1 + 39 * 4.0f);
  EXPECT_FLOAT_EQ(large.Final(1).at(39).x, 1 + 39 * 2.0f);  // half a feature pixel is two pixels of this frame
}

TEST_F(EngineTest, AnEmptySessionEndsWell) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_THAT(listener.updates(), IsEmpty());
}

TEST_F(EngineTest, ASessionOfOneFrameReportsTheQueries) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1.25f, 1}}), listener);
  PushFrames(*session, listener, 0, 1);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(listener.Final(1), (FinalTrack{{0, {1.25f, 1, true, 1}}}));
  EXPECT_EQ(counts_->rows, 0);
}

TEST_F(EngineTest, RefusesAtOnceWhatDoesNotFit) {
  options_.max_sessions = 1;
  RecordingListener first, second;
  auto session = Open(Config(), first);
  const auto refused = engine().OpenSession(Config(), second);
  ASSERT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(OverloadDetails(refused.status())->subject, "sessions");
  session->Finish();
  EXPECT_THAT(first.AwaitDone(), IsOk());
  EXPECT_THAT(engine().OpenSession(Config(), second), IsOk()) << "who heard of the end may come back";
}

TEST_F(EngineTest, RefusesASessionThatNeedsMoreThanTheMemoryBudget) {
  options_.cache_budget_bytes = 39 * FakeTrackerModel::kFrameBytes;  // 24 + 8 + 8 are needed
  RecordingListener listener;
  EXPECT_THAT(engine().OpenSession(Config(), listener), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(metrics_.totals().rejected_memory, 1);
}

TEST_F(EngineTest, AFailureOfTheNetworkEndsOnlyTheSessionsOfItsBatch) {
  std::atomic<bool> fail{false};
  model_->before_refine = [&fail](absl::Span<const WindowGroup>) {
    if (fail.exchange(false)) throw std::runtime_error("/secret/path");
  };
  RecordingListener unlucky, lucky;
  auto first = Open(Config({{1, 1, 1}}), unlucky);
  auto second = Open(Config({{1, 1, 1}}), lucky);
  fail = true;
  PushFrames(*first, unlucky, 0, 8);
  const absl::Status status = unlucky.AwaitDone();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(std::string(status.message()), ::testing::Not(HasSubstr("secret")));
  PushFrames(*second, lucky, 0, 30);
  second->Finish();
  EXPECT_THAT(lucky.AwaitDone(), IsOk());
  EXPECT_THAT(lucky.Final(1), SizeIs(30));
}

TEST_F(EngineTest, MemoryThatEndsIsAnOverload) {
  model_->before_encode = [] { throw std::bad_alloc(); };
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 1);
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kResourceExhausted));
}

TEST_F(EngineTest, AOnePointSessionKeepsItsPaceBesideOneOfAThousand) {
  options_.max_batch_rows = 50;
  options_.max_pending_frames = 24;
  Gate gate;
  std::atomic<int64_t> batches{0}, batch_of_single{0};
  model_->before_refine = [&](absl::Span<const WindowGroup> groups) {
    gate.Pass();
    ++batches;
    for (const WindowGroup& group : groups) {
      for (const WindowRow& row : group.rows) {
        if (row.feature[1] == 1.0f) batch_of_single = batches.load();
      }
    }
  };
  std::vector<PointQuery> points;
  for (PointId id = 0; id < 1000; ++id) points.push_back({id, 32, 1});
  SessionConfig crowd_config = Config(points), single_config = Config({{1, 8, 1}});  // feature pixels 4 and 1
  crowd_config.send_provisional = single_config.send_provisional = false;
  RecordingListener crowd, single;
  auto crowd_session = Open(crowd_config, crowd);
  PushFrames(*crowd_session, crowd, 0, 24);
  gate.AwaitWaiting();  // the first of the 20 batches that the crowd's rows take
  auto single_session = Open(single_config, single);
  PushFrames(*single_session, single, 0, 24);
  metrics_.AwaitStage(Stage::kDecode, 48);
  gate.Open();
  crowd_session->Finish();
  single_session->Finish();
  EXPECT_THAT(crowd.AwaitDone(), IsOk());
  EXPECT_THAT(single.AwaitDone(), IsOk());
  EXPECT_LE(batch_of_single, 8);  // the first batch, and one beside each of the 6 that encode its 24 frames
  EXPECT_LE(metrics_.totals().max_batch_rows, 50);
  EXPECT_EQ(metrics_.totals().rows, 1001);
}

TEST_F(EngineTest, TellsTheMetrics) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 40);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  session.reset();
  auto totals = metrics_.totals();
  EXPECT_EQ(totals.opened, 1);
  EXPECT_EQ(totals.closed[SessionOutcome::kCompleted], 1);
  EXPECT_EQ(totals.frames[FrameResult::kTracked], 40);
  EXPECT_EQ(totals.stages[Stage::kDecode], 40);
  EXPECT_EQ(totals.stages[Stage::kQueue], 40);
  EXPECT_GT(totals.stages[Stage::kEncode], 0);
  EXPECT_GT(totals.stages[Stage::kRefine], 0);
  EXPECT_GT(totals.stages[Stage::kEmit], 0);
  EXPECT_EQ(totals.rows, counts_->rows);
  EXPECT_THAT(totals.first, SizeIs(40));
  EXPECT_THAT(totals.final, SizeIs(40));
  EXPECT_THAT(totals.lags, SizeIs(40));
  EXPECT_THAT(totals.lags, Each(Le(8 + 4)));
  EXPECT_EQ(totals.points, 0);
}

TEST(BatcherTest, SharesFairly) {
  EXPECT_THAT(FairShares({1000, 1}, 50), ElementsAre(49, 1));
  EXPECT_THAT(FairShares({10, 10, 10}, 7), ElementsAre(3, 2, 2));
  EXPECT_THAT(FairShares({1, 2, 100}, 12), ElementsAre(1, 2, 9));
  EXPECT_THAT(FairShares({1, 1}, 50), ElementsAre(1, 1));
  EXPECT_THAT(FairShares({5, 5, 5}, 2), ElementsAre(1, 1, 0));
  EXPECT_THAT(FairShares({}, 5), IsEmpty());
}

}  // namespace
}  // namespace holdfast
