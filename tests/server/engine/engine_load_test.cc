// SPDX-License-Identifier: Apache-2.0
// What the engine does under load and when things fail: bounds, fairness, refusal, cancellation, metrics.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "api/errors.h"
#include "tests/server/engine/engine_fixture.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::Ge;
using ::testing::HasSubstr;
using ::testing::Le;
using ::testing::SizeIs;

TEST_F(EngineTest, MemoryAfter2000FramesIsThatAfter200) {
  RecordingListener listener;
  SessionConfig config = Config({{1, 1, 1}, {2, 2, 2}});
  config.motion_prior = config.polish = false;  // features alone
  auto session = Open(config, listener);
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
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kMemory], 1);
}

// A point-frame takes a millisecond and a frame as much as ten of them; 800 a second may be promised.
TEST_F(EngineTest, RefusesASessionWhoseRateCannotBeKeptAndTellsItsLoad) {
  options_.hop_frames = 8;
  options_.iterations = 4;
  model_->SetCosts({/*pixel=*/10e-3 / Pixels(kFrame), /*batch=*/0, /*row=*/2e-3});
  options_.processing_size = kFrame;
  RecordingListener first, second;
  SessionConfig config = Config({{1, 1, 1}});
  config.frames_per_second = 20;
  config.expected_points = 20;
  auto session = Open(config, first);
  TrackerLoad load = engine().info().load;
  EXPECT_EQ(load.sessions, 1);
  EXPECT_NEAR(load.frame_work, 10, 1e-9);
  EXPECT_NEAR(load.work_budget, 800, 1e-6);
  EXPECT_NEAR(load.work_promised, 20 * (10 + 20), 1e-6);
  EXPECT_THAT(engine().OpenSession(config, second), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kWork], 1);
  RecordingListener any_pace;
  auto slow = Open(Config({{1, 1, 1}, {2, 2, 2}}), any_pace);  // half a frame a second is promised
  PushFrames(*slow, any_pace, 0, 24);
  any_pace.AwaitFinal(2, 1);
  load = engine().info().load;
  EXPECT_EQ(load.sessions, 2);
  EXPECT_EQ(load.points, 2) << "the first session has no frame yet";
  EXPECT_NEAR(load.work_promised, 606, 1e-6);
  slow.reset();
  session.reset();
  EXPECT_EQ(engine().info().load.sessions, 0);
  EXPECT_EQ(engine().info().load.points, 0);
  EXPECT_EQ(metrics_.totals().work_promised, 0);
}

// Costs as above.
TEST_F(EngineTest, ALoadedEngineTakesALargerHopOfTheBoundsAndTheTracksAreThoseOfThatHop) {
  model_->SetCosts({/*pixel=*/10e-3 / Pixels(kFrame), /*batch=*/0, /*row=*/2e-3});
  model_->keep_starts = true;  // where a window starts shows in its estimates
  // Batches that take no time by the clock make the budget large until they are forgotten.
  const auto forget_batches = [this] { clock_.Advance(absl::Hours(1)); };
  const auto track = [&](const SessionConfig& config, int hop) {
    forget_batches();
    RecordingListener listener;
    auto session = Open(config, listener);
    EXPECT_EQ(session->accepted().hop_frames, hop);
    PushFrames(*session, listener, 0, 50);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    return listener.Final(1);
  };
  SessionConfig bounded = Config({{1, 1, 1}}, 4);
  bounded.max_hop_frames = 16;
  bounded.frames_per_second = 5;
  bounded.expected_points = 44;  // 5 x (10 + 44 x 8 / hop): 490 with hop 4, 210 with 11, 197 with 12
  const auto quiet = track(bounded, 4);
  RecordingListener listener;
  SessionConfig other = Config({{1, 1, 1}});
  other.frames_per_second = other.expected_points = 20;  // takes 600 of 800
  auto session = Open(other, listener);
  const auto loaded = track(bounded, 12);
  EXPECT_TRUE(loaded == track(Config({{1, 1, 1}}, 12), 12));
  EXPECT_FALSE(loaded == quiet);
  bounded.max_hop_frames = 11;
  forget_batches();
  EXPECT_THAT(engine().OpenSession(bounded, listener), StatusIs(absl::StatusCode::kResourceExhausted));
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
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kFailed], 1);
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
  // Windows would wait for optical flow, whose time is that of other threads.
  crowd_config.motion_prior = single_config.motion_prior = false;
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

TEST_F(EngineTest, AWallClockThatJumpsChangesNoLatency) {
  std::atomic<int> calls{0};
  model_->before_encode = [&] {
    clock_.SetWallBy(++calls % 2 == 0 ? absl::Hours(11) : -absl::Hours(9));
    clock_.Advance(absl::Milliseconds(10));
  };
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 40);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  const auto totals = metrics_.totals();
  const auto plausible = AllOf(Ge(absl::ZeroDuration()), Le(40 * absl::Milliseconds(10)));
  EXPECT_THAT(totals.first, AllOf(SizeIs(40), Each(plausible)));
  EXPECT_THAT(totals.final, AllOf(SizeIs(40), Each(plausible)));
  EXPECT_THAT(totals.shortest_stage, plausible);
  EXPECT_THAT(totals.longest_stage, plausible);
}

}  // namespace
}  // namespace holdfast
