// SPDX-License-Identifier: Apache-2.0
#include "server/engine/local_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "server/engine/engine_with_model.h"
#include "tests/support/fake_tracker_model.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

class LocalTrackerTest : public ::testing::Test {
 protected:
  LocalTrackerTest()
      : engine_(*CreateEngineWithModel({}, std::make_unique<FakeTrackerModel>(), clock_, metrics_)),
        tracker_(*engine_) {}

  static SessionConfig Config() {
    SessionConfig config;
    config.encoding = FrameEncoding::kGray8;
    config.raw_size = config.processing_size = {32, 32};
    config.points = {{1, 4, 4}};
    return config;
  }
  static Frame MakeFrame(int64_t index) { return {index, std::string(32 * 32, 'x')}; }

  SimulatedClock clock_;
  NullEngineMetrics metrics_;
  std::unique_ptr<Engine> engine_;
  LocalTracker tracker_;
};

TEST_F(LocalTrackerTest, TracksAClip) {
  RecordingObserver observer;
  auto stream = tracker_.Open(Config(), observer);
  ASSERT_THAT(stream, IsOk());
  for (int64_t i = 0; i < 100; ++i) ASSERT_THAT((*stream)->PushFrame(MakeFrame(i)), IsOk());
  EXPECT_THAT((*stream)->Finish(), IsOk());
  EXPECT_TRUE(observer.done()) << "before Finish returned";
  EXPECT_EQ(observer.accepted()->hop_frames, 8);
  EXPECT_THAT(observer.Final(1), SizeIs(100));
  EXPECT_THAT((*stream)->PushFrame(MakeFrame(100)), StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST_F(LocalTrackerTest, ARefusedSessionHearsOnlyOfItsEnd) {
  RecordingObserver observer;
  SessionConfig config = Config();
  config.hop_frames = 99;
  const auto stream = tracker_.Open(config, observer);
  EXPECT_THAT(stream, StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_EQ(observer.AwaitDone(), stream.status());
  EXPECT_FALSE(observer.accepted().has_value());
}

TEST_F(LocalTrackerTest, AnErrorComesFromEveryLaterCallAndFromTheObserver) {
  RecordingObserver observer;
  auto stream = *tracker_.Open(Config(), observer);
  for (int64_t i = 0; i < 10; ++i) ASSERT_THAT(stream->PushFrame(MakeFrame(i)), IsOk());
  const absl::Status error = stream->PushFrame({10, "short"});
  EXPECT_THAT(error, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame 10")));
  EXPECT_EQ(stream->PushFrame(MakeFrame(10)), error);
  EXPECT_EQ(stream->AddPoints({{2, 1, 1}}), error);
  EXPECT_EQ(stream->Finish(), error);
  EXPECT_EQ(observer.AwaitDone(), error);
  EXPECT_THAT(observer.Final(1), SizeIs(10)) << "what came before was tracked to the end";
}

TEST_F(LocalTrackerTest, CancellingEndsTheStreamAtOnce) {
  RecordingObserver observer;
  auto stream = *tracker_.Open(Config(), observer);
  ASSERT_THAT(stream->PushFrame(MakeFrame(0)), IsOk());
  stream->Cancel();
  EXPECT_THAT(observer.AwaitDone(), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kCancelled));
}

TEST_F(LocalTrackerTest, DestructionWaitsForTheEnd) {
  RecordingObserver observer;
  auto stream = *tracker_.Open(Config(), observer);
  for (int64_t i = 0; i < 30; ++i) ASSERT_THAT(stream->PushFrame(MakeFrame(i)), IsOk());
  stream.reset();
  EXPECT_TRUE(observer.done());
}

TEST_F(LocalTrackerTest, AddsAndRemovesPointsAtTheNewestFrame) {
  RecordingObserver observer;
  auto stream = *tracker_.Open(Config(), observer);
  for (int64_t i = 0; i < 10; ++i) ASSERT_THAT(stream->PushFrame(MakeFrame(i)), IsOk());
  ASSERT_THAT(stream->AddPoints({{2, 1, 1}}), IsOk());
  ASSERT_THAT(stream->RemovePoints({1}), IsOk());
  for (int64_t i = 10; i < 20; ++i) ASSERT_THAT(stream->PushFrame(MakeFrame(i)), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_EQ(observer.Final(2).begin()->first, 9);
  EXPECT_EQ(observer.Final(2).rbegin()->first, 19);
  EXPECT_EQ(observer.Final(1).rbegin()->first, 9);
}

// An observer that takes its time holds the stream, not the engine.
class SlowObserver final : public TrackObserver {
 public:
  void OnTracks(TrackUpdate) override {
    absl::MutexLock lock(&mutex_);
    entered_ = true;
    changed_.SignalAll();
    while (!released_) changed_.Wait(&mutex_);
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}
  void AwaitEntered() {
    absl::MutexLock lock(&mutex_);
    while (!entered_) changed_.Wait(&mutex_);
  }
  void Release() {
    absl::MutexLock lock(&mutex_);
    released_ = true;
    changed_.SignalAll();
  }

 private:
  absl::Mutex mutex_;
  absl::CondVar changed_;
  bool entered_ ABSL_GUARDED_BY(mutex_) = false;
  bool released_ ABSL_GUARDED_BY(mutex_) = false;
};

TEST_F(LocalTrackerTest, ASlowObserverDoesNotHoldOtherStreams) {
  SlowObserver slow;
  RecordingObserver quick;
  auto held = *tracker_.Open(Config(), slow);
  for (int64_t i = 0; i < 8; ++i) ASSERT_THAT(held->PushFrame(MakeFrame(i)), IsOk());
  slow.AwaitEntered();
  auto stream = *tracker_.Open(Config(), quick);
  for (int64_t i = 0; i < 50; ++i) ASSERT_THAT(stream->PushFrame(MakeFrame(i)), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  slow.Release();
  EXPECT_THAT(held->Finish(), IsOk());
}

}  // namespace
}  // namespace holdfast
