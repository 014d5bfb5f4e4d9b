// SPDX-License-Identifier: Apache-2.0
// Sessions that go on where others were: whenever the first one ends, the second one's final tracks are those of a
// session that was never interrupted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/server/engine/resume_fixture.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

enum class End { kKilled, kSuspended };

// The first session ends after each number of frames.
class InterruptedTest : public ResumeTest, public ::testing::WithParamInterface<std::tuple<End, bool, bool, Emit>> {
 protected:
  SessionConfig MakeParamConfig() const {
    SessionConfig config = MakeConfig();
    config.motion_prior = std::get<1>(GetParam());
    config.polish = std::get<2>(GetParam());
    config.emit = std::get<3>(GetParam());
    return config;
  }
  std::vector<Checkpoint> Interrupt(const SessionConfig& config, int64_t frames, Tracks& tracks) {
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, frames);
    if (std::get<0>(GetParam()) == End::kSuspended) {
      session->Suspend(absl::UnavailableError("going away"));
      EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
    }
    session.reset();
    Merge(FinalsOf(listener), tracks);
    return listener.checkpoints();
  }
};

TEST_P(InterruptedTest, FinalTracksAreThoseOfASessionThatWasNot) {
  const SessionConfig config = MakeParamConfig();
  const Tracks expected = Uninterrupted(config);
  const int64_t points = points_;
  for (int64_t frames = 1; frames <= kFrames; frames += frames % 5 == 0 ? 2 : 3) {
    SCOPED_TRACE(frames);
    Tracks tracks;
    const std::vector<Checkpoint> checkpoints = Interrupt(config, frames, tracks);
    RecordingListener listener;
    auto session = Resume(config, checkpoints, listener, kFrames);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    Merge(FinalsOf(listener), tracks);
    EXPECT_EQ(Difference(tracks, expected), "") << Describe(checkpoints);
    EXPECT_EQ(listener.summary().frames, kFrames);
    EXPECT_EQ(listener.summary().points, points);
  }
}

INSTANTIATE_TEST_SUITE_P(All, InterruptedTest,
                         ::testing::Values(std::make_tuple(End::kKilled, true, true, Emit::kWindows),
                                           std::make_tuple(End::kSuspended, true, true, Emit::kEveryFrame),
                                           std::make_tuple(End::kSuspended, true, false, Emit::kWindows),
                                           std::make_tuple(End::kKilled, false, true, Emit::kWindows),
                                           std::make_tuple(End::kSuspended, false, false, Emit::kWindows)));

class OftenInterruptedTest : public ResumeTest, public ::testing::WithParamInterface<ImageSize> {};

TEST_P(OftenInterruptedTest, ManyInterruptionsOfOneStreamChangeNothing) {
  SessionConfig config = MakeConfig();
  config.processing_size = GetParam();
  const Tracks expected = Uninterrupted(config);
  Tracks tracks;
  std::vector<Checkpoint> checkpoints;
  for (int64_t end = 2; end < kFrames; end += 3) {
    RecordingListener listener;
    auto session = Resume(config, checkpoints, listener, end);
    session->Suspend(absl::UnavailableError("going away"));
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
    Merge(FinalsOf(listener), tracks);
    if (!listener.checkpoints().empty()) checkpoints = listener.checkpoints();
  }
  RecordingListener listener;
  auto session = Resume(config, checkpoints, listener, kFrames);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  Merge(FinalsOf(listener), tracks);
  EXPECT_EQ(Difference(tracks, expected), "");
}

// A feature pixel is 8 pixels of what flow sees, or 32 / 3 and 12, which rounds positions.
INSTANTIATE_TEST_SUITE_P(Sizes, OftenInterruptedTest, ::testing::Values(kPicture, ImageSize{96, 64}));

TEST_F(ResumeTest, TheScriptLosesAPointAndFindsItAgain) {
  model_->step = 0;
  const Tracks tracks = Uninterrupted(MakeConfig());
  const FinalTrack& track = tracks.at(4);  // queried after frame 10
  const FlowPoint begin = Script::ShiftAt(11), end = Script::ShiftAt(50);
  EXPECT_NEAR(track.at(50).x, 50 + end.x - begin.x, 1);
  EXPECT_NEAR(track.at(50).y, 60 + end.y - begin.y, 1);
}

TEST_F(ResumeTest, EarlierFramesAreIgnored) {
  const SessionConfig config = MakeConfig();
  const Tracks expected = Uninterrupted(config);
  RecordingListener first, second;
  SuspendAt50(first);
  const int64_t encoded = counts_->frames;
  SessionConfig resumed = config;
  resumed.resume_token = first.checkpoints().back().token;
  const int64_t next = first.checkpoints().back().next_frame;
  ASSERT_GE(next, 10);
  auto session = Open(resumed, second);
  Say(*session, second, 0, kFrames);  // all of it
  session->Finish();
  EXPECT_THAT(second.AwaitDone(), IsOk());
  EXPECT_EQ(counts_->frames - encoded, kFrames - next);
  Tracks tracks = FinalsOf(first);
  Merge(FinalsOf(second), tracks);
  EXPECT_EQ(Difference(tracks, expected), "");
}

TEST_F(ResumeTest, ACheckpointLiesNoFurtherBehindThanWasSaid) {
  SessionConfig config = MakeConfig();
  config.checkpoint_interval_frames = 10;
  RecordingListener listener;
  auto session = Open(config, listener);
  EXPECT_EQ(session->accepted().checkpoint_interval_frames, 10);
  const int64_t replay = session->accepted().replay_frames;
  EXPECT_EQ(replay, 24 + 2 * 8 + options_.max_pending_frames);
  int64_t kept_from = 0;  // by a client that keeps no more than it has to
  for (int64_t i = 0; i < 300; ++i) {
    Frame frame = Script::At(i % 5);
    frame.index = i;
    frame.points.clear();
    ASSERT_THAT(listener.Push(*session, std::move(frame)), IsOk());
    if (i + 1 - kept_from < replay + 10) continue;
    listener.AwaitCheckpoints(1);
    const int64_t before = kept_from;
    for (size_t count = listener.checkpoints().size(); kept_from == before; ++count) {
      listener.AwaitCheckpoints(count);
      kept_from = listener.checkpoints().back().next_frame;
    }
  }
}

class FarBehindTest : public ResumeTest {
 protected:
  // A session with as many frames in its cache as a server with room for more of them lets in before it refines the
  // first row, which is due with frame 20, where a point is removed. Suspended.
  void SuspendFarBehind(const SessionConfig& config, RecordingListener& listener) {
    constexpr int64_t kPending = 32, kSaid = 21 + kPending;
    EngineOptions options = options_;
    options.max_pending_frames = kPending;
    options.max_batch_frames = kSaid;
    options.max_batch_rows = 1;
    RecordingMetrics metrics;
    Gate gate;
    int refined = 0;
    auto model = std::make_unique<FakeTrackerModel>();
    model->keep_starts = model_->keep_starts;
    model->step = model_->step;
    model->before_refine = [&](absl::Span<const WindowGroup>) {
      if (++refined == 1) {
        metrics.AwaitStage(Stage::kDecode, kSaid);  // the next turn encodes them all
      } else {
        gate.Pass();
      }
    };
    auto engine = CreateEngineWithModel(options, std::move(model), clock_, metrics);
    ASSERT_THAT(engine, IsOk());
    auto session = (*engine)->OpenSession(config, listener);
    ASSERT_THAT(session, IsOk());
    Say(**session, listener, 0, kSaid);
    gate.AwaitWaiting();
    (*session)->Suspend(absl::UnavailableError("going away"));
    gate.Open();
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  }
};

// The frames that come again are more than a session of this server holds otherwise.
TEST_F(FarBehindTest, AServerThatHoldsFewerFramesTakesUpASessionThatWasFarBehind) {
  SessionConfig config = MakeConfig();
  config.send_provisional = false;
  RecordingListener first, second;
  SuspendFarBehind(config, first);
  const SessionState state = *sealer_.Unseal(first.checkpoints().back().token);
  const int64_t again = state.taken_frame - state.next_frame + 1;
  ASSERT_GT(again, 24 + 2 * 8 + options_.max_pending_frames);
  const Tracks expected = Uninterrupted(config);
  SessionConfig resumed = config;
  resumed.resume_token = first.checkpoints().back().token;
  auto session = Open(resumed, second);
  ASSERT_GE(session->accepted().replay_frames, again) << "else it waits for ever";
  Say(*session, second, state.next_frame, kFrames);
  session->Finish();
  EXPECT_THAT(second.AwaitDone(), IsOk());
  Tracks tracks = FinalsOf(first);
  Merge(FinalsOf(second), tracks);
  EXPECT_EQ(Difference(tracks, expected), "");
}

TEST_F(ResumeTest, ChecksTheIndexOfTheFirstFrame) {
  RecordingListener first, second;
  SuspendAt50(first);
  SessionConfig config = MakeConfig();
  config.resume_token = first.checkpoints().back().token;
  const int64_t next = first.checkpoints().back().next_frame;
  auto session = Open(config, second);
  EXPECT_THAT(session->PushFrame(Script::At(next + 1)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("the session goes on with frame")));
  EXPECT_THAT(session->PushFrame(Script::At(next - 2)), IsOk());
  EXPECT_THAT(session->PushFrame(Script::At(next)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("came instead of frame")));
}

TEST_F(ResumeTest, AStreamThatEndsBeforeItHasCaughtUpIsToldSo) {
  RecordingListener first;
  SuspendAt50(first);
  const int64_t next = first.checkpoints().back().next_frame;
  for (const int64_t frames : {0, 1, 10}) {
    RecordingListener second;
    auto session = Resume(MakeConfig(), first.checkpoints(), second, next + frames);
    session->Finish();
    EXPECT_THAT(second.AwaitDone(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("the stream ended after")));
  }
}

TEST_F(ResumeTest, SuspendingBeforeThereIsAnythingToKeepGivesNoCheckpoint) {
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  session->Suspend(absl::UnavailableError("going away"));
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(listener.checkpoints(), IsEmpty());
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kSuspended], 1);
  EXPECT_THAT(session->PushFrame(Script::At(0)), StatusIs(absl::StatusCode::kUnavailable));
}

// The scheduler sees frames that are ready, and the session may be suspended before it takes them.
TEST_F(ResumeTest, ASessionMayBeSuspendedAtAnyMoment) {
  for (int round = 0; round < 1500; ++round) {
    RecordingListener listener;
    auto session = Open(Config({{1, 10, 10}}), listener);
    ASSERT_NE(session, nullptr);
    for (int64_t i = 0; i < 30; ++i) ASSERT_THAT(listener.Push(*session, MakeFrame(i)), IsOk());
    session->Suspend(absl::UnavailableError("going away"));
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  }
}

TEST_F(ResumeTest, SuspendingWhileItFinishesLosesNothing) {
  const SessionConfig config = MakeConfig();
  const Tracks expected = Uninterrupted(config);
  RecordingListener first;
  auto session = Open(config, first);
  Say(*session, first, 0, kFrames);
  session->Finish();
  session->Suspend(absl::UnavailableError("going away"));
  const absl::Status end = first.AwaitDone();
  Tracks tracks = FinalsOf(first);
  if (!end.ok()) {
    RecordingListener second;
    const auto resumed = Resume(config, first.checkpoints(), second, kFrames);
    resumed->Finish();
    EXPECT_THAT(second.AwaitDone(), IsOk());
    Merge(FinalsOf(second), tracks);
  }
  EXPECT_EQ(Difference(tracks, expected), "");
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kCompleted], 2) << "the uninterrupted one, and one of these";
}

// Does what another thread may do, while the session takes its turn on the compute thread.
class InterruptingMetrics final : public NullEngineMetrics {
 public:
  // When the second frame has become final: in a turn that has begun, before it looks whether the stream is at its end.
  std::function<void()> interrupt;
  int suspended = 0;

  void FinalEstimate(absl::Duration) override {
    if (++finals_ == 2) interrupt();
  }
  void SessionClosed(SessionOutcome outcome) override { suspended += outcome == SessionOutcome::kSuspended ? 1 : 0; }

 private:
  int finals_ = 0;
};

TEST_F(ResumeTest, SuspendingInTheMiddleOfATurnMakesNothingFinal) {
  for (const bool polish : {true, false}) {
    SCOPED_TRACE(polish);
    SessionConfig config = MakeConfig();
    config.polish = polish;
    const Tracks expected = Uninterrupted(config);
    InterruptingMetrics metrics;
    auto model = std::make_unique<FakeTrackerModel>();
    model->keep_starts = model_->keep_starts;
    model->step = model_->step;
    auto engine = CreateEngineWithModel(options_, std::move(model), clock_, metrics);
    ASSERT_THAT(engine, IsOk());
    RecordingListener first, second;
    auto session = (*engine)->OpenSession(config, first);
    ASSERT_THAT(session, IsOk());
    metrics.interrupt = [&] { (*session)->Suspend(absl::UnavailableError("going away")); };
    Say(**session, first, 0, 24);  // the first window's
    EXPECT_THAT(first.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
    EXPECT_EQ(metrics.suspended, 1);
    Tracks tracks = FinalsOf(first);
    const auto resumed = Resume(config, first.checkpoints(), second, kFrames);
    resumed->Finish();
    EXPECT_THAT(second.AwaitDone(), IsOk());
    Merge(FinalsOf(second), tracks);
    EXPECT_EQ(Difference(tracks, expected), "") << Describe(first.checkpoints());
  }
}

// A point is queried anew at the newest frame, and the session suspended while the last window of its track before
// runs.
TEST_F(ResumeTest, AFrameAtWhichAPointIsQueriedAnewIsNotFinalBefore) {
  constexpr int64_t kAnew = 28;
  std::function<void()> in_last_window;
  int refined = 0;
  model_->before_refine = [&](absl::Span<const WindowGroup>) {
    if (++refined == 2) in_last_window();  // the first is the one that frame 23 makes due
  };
  SessionConfig config = MakeConfig();
  config.points = {{1, 40.5f, 50.25f}};
  config.send_provisional = false;
  RecordingListener listener;
  auto session = Open(config, listener);
  in_last_window = [&] { session->Suspend(absl::UnavailableError("going away")); };
  for (int64_t i = 0; i <= kAnew; ++i) ASSERT_THAT(listener.Push(*session, {i, Script::PictureAt(i)}), IsOk());
  ASSERT_THAT(session->AddPoints({{1, 60, 40}}), IsOk());
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  ASSERT_THAT(listener.checkpoints(), Not(IsEmpty()));
  const SessionState state = *sealer_.Unseal(listener.checkpoints().back().token);
  ASSERT_THAT(state.tracks, SizeIs(1)) << "it waits to be polished";
  EXPECT_EQ(state.tracks[0].state.covered, kAnew) << "its last window has run";
  EXPECT_EQ(state.tracks[0].state.final_before, kAnew);
}

TEST_F(ResumeTest, WithoutASealerThereIsNoCheckpoint) {
  options_.sealer = nullptr;
  RecordingListener listener, refused;
  auto session = Open(MakeConfig(), listener);
  EXPECT_EQ(session->accepted().replay_frames, 0);
  EXPECT_EQ(session->accepted().checkpoint_interval_frames, 0);
  Say(*session, listener, 0, 30);
  session->Suspend(absl::UnavailableError("going away"));
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(listener.checkpoints(), IsEmpty());
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kFailed], 1) << "what it had tracked is lost";
  SessionConfig config = MakeConfig();
  config.resume_token = "0";
  EXPECT_THAT(engine().OpenSession(config, refused), StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST_F(ResumeTest, ATokenThatDoesNotFitEndsCheckpointsNotTheSession) {
  sealer_.full = true;
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  Say(*session, listener, 0, kFrames);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  ASSERT_THAT(listener.checkpoints(), SizeIs(1));
  EXPECT_THAT(listener.checkpoints()[0].token, IsEmpty());
  EXPECT_FALSE(listener.checkpoints()[0].resumable);
}

TEST_F(ResumeTest, ASealerThatFailsOnceIsAskedAgain) {
  sealer_.failures = 1;
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  Say(*session, listener, 0, kFrames);
  session->Suspend(absl::UnavailableError("going away"));
  EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_EQ(sealer_.failures, 0);
  ASSERT_THAT(listener.checkpoints(), Not(IsEmpty()));
  for (const Checkpoint& checkpoint : listener.checkpoints()) EXPECT_THAT(checkpoint.token, Not(IsEmpty()));
}

// Whoever puts the mistake right goes on from before it.
TEST_F(ResumeTest, AMistakeLeavesACheckpoint) {
  SessionConfig config = MakeConfig();
  config.checkpoint_interval_frames = 0;
  const Tracks expected = Uninterrupted(config);
  RecordingListener first, second;
  auto session = Open(config, first);
  Say(*session, first, 0, 50);
  const absl::Status mistake = absl::InvalidArgumentError("frame 50 is no picture");
  session->Fail(mistake);
  EXPECT_EQ(first.AwaitDone(), mistake);
  EXPECT_THAT(first.Final(4), SizeIs(40)) << "from frame 10 on";
  ASSERT_THAT(first.checkpoints(), SizeIs(1));
  const auto resumed = Resume(config, first.checkpoints(), second, kFrames);
  resumed->Finish();
  EXPECT_THAT(second.AwaitDone(), IsOk());
  for (const auto& [id, track] : FinalsOf(second)) {
    EXPECT_TRUE(track.empty() || track.rbegin()->first == expected.at(id).rbegin()->first) << id;
    for (const auto& [frame, sample] : track) EXPECT_TRUE(sample == expected.at(id).at(frame)) << id << " " << frame;
  }
  EXPECT_THAT(second.Final(4), Not(IsEmpty()));
}

TEST_F(ResumeTest, AfterAMistakeNoCheckpointFollowsTheLast) {
  const SessionConfig config = MakeConfig();
  for (int64_t frames = 46; frames < 52; ++frames) {  // some are a checkpoint's interval from the one before
    SCOPED_TRACE(frames);
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, frames);
    session->Fail(absl::InvalidArgumentError("the next frame is no picture"));
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kInvalidArgument));
    ASSERT_THAT(listener.checkpoints(), Not(IsEmpty()));
    const SessionState state = *sealer_.Unseal(listener.checkpoints().back().token);
    EXPECT_EQ(state.taken_frame, frames - 1);
    for (const SessionState::Track& track : state.tracks) {
      EXPECT_TRUE(track.state.ending || track.state.final_before < frames) << "the last windows may run otherwise";
    }
  }
}

TEST_F(ResumeTest, ASlowSealerHoldsNoOtherSessionUp) {
  Gate gate;
  sealer_.before_seal = [&gate] { gate.Pass(); };
  options_.decode_threads = 3;
  RecordingListener slow, other;
  auto sealing = Open(MakeConfig(), slow);
  Say(*sealing, slow, 0, 9);
  gate.AwaitWaiting();
  SessionConfig config = MakeConfig();
  config.checkpoint_interval_frames = 0;
  auto session = Open(config, other);
  Say(*session, other, 0, kFrames);
  session->Finish();
  EXPECT_THAT(other.AwaitDone(), IsOk());
  EXPECT_THAT(slow.checkpoints(), IsEmpty());
  gate.Open();
  sealing.reset();
  session.reset();
  engine_.reset();  // its threads use the gate
}

}  // namespace
}  // namespace holdfast
