// SPDX-License-Identifier: Apache-2.0
// Sessions that go on where others were: whenever the first one ends, the second one's final tracks are those of a
// session that was never interrupted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/server/engine/engine_fixture.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr int64_t kFrames = 64;
constexpr PointId kIds[] = {1, 2, 3, 4, 5};

using Tracks = std::map<PointId, FinalTrack>;

// The first difference, if there is one.
std::string Difference(const Tracks& tracks, const Tracks& expected) {
  for (const PointId id : kIds) {
    const FinalTrack &a = tracks.at(id), &b = expected.at(id);
    for (int64_t frame = 0; frame < kFrames; ++frame) {
      const auto in_a = a.find(frame), in_b = b.find(frame);
      const bool same = (in_a == a.end()) == (in_b == b.end()) && (in_a == a.end() || in_a->second == in_b->second);
      if (same) continue;
      std::string text = absl::StrCat("point ", id, ", frame ", frame, ":");
      for (const auto& [found, track] : {std::make_pair(in_a, &a), std::make_pair(in_b, &b)}) {
        const bool there = found != track->end();
        absl::StrAppend(&text, " ", there ? absl::StrCat(found->second.x, ",", found->second.y) : "nothing");
      }
      return text;
    }
  }
  return "";
}

// What a client says: points that come and go before the first window is full, in the middle, and near the end.
struct Script {
  static std::vector<PointQuery> AtFirst() { return {{1, 40.5f, 50.25f}, {2, 80, 30}}; }
  static const std::string& PictureAt(int64_t index) {
    static auto& made = *new std::map<int64_t, std::string>();
    std::string& picture = made[index];
    const auto t = static_cast<float>(index);
    if (picture.empty()) picture = BytesOf(ShiftedTexture(kPicture, 0.75f * t, 0.25f * t));
    return picture;
  }
  static Frame At(int64_t index) {
    Frame frame{index, PictureAt(index), {}, {}};
    if (index == 5) frame.points = {{3, 60, 40}};
    if (index == 33) frame.points = {{1, 70, 45}};  // again
    if (index == 58) frame.points = {{5, 64, 48}};
    return frame;
  }
  static void After(int64_t index, EngineSession& session) {
    if (index == 10) {
      EXPECT_THAT(session.AddPoints({{4, 50, 60}}), IsOk());
    }
    if (index == 20) {
      EXPECT_THAT(session.RemovePoints({2}), IsOk());
    }
    if (index == 40) {
      EXPECT_THAT(session.RemovePoints({3, 99}), IsOk());
    }
    if (index == 40) {
      EXPECT_THAT(session.AddPoints({{3, 30, 30}, {2, 90, 60}}), IsOk());
    }
  }
};

class ResumeTest : public EngineTest {
 protected:
  ResumeTest() {
    options_.sealer = &sealer_;
    model_->keep_starts = true;
    model_->step = 0.03f;
  }

  static SessionConfig MakeConfig(int hop = 8) {
    SessionConfig config = Config(Script::AtFirst(), hop);
    config.raw_size = config.processing_size = kPicture;
    config.checkpoint_interval_frames = 4;
    return config;
  }

  static void Say(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      ASSERT_THAT(listener.Push(session, Script::At(i)), IsOk());
      Script::After(i, session);
    }
  }

  static Tracks FinalsOf(const RecordingListener& listener) {
    Tracks tracks;
    for (const PointId id : kIds) tracks[id] = listener.Final(id);
    return tracks;
  }

  Tracks Uninterrupted(const SessionConfig& config, int64_t frames = kFrames) {
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, frames);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    points_ = listener.summary().points;
    return FinalsOf(listener);
  }

  // A session that has come well into the stream, suspended.
  std::vector<Checkpoint> SuspendAt50(RecordingListener& listener) {
    auto session = Open(MakeConfig(), listener);
    Say(*session, listener, 0, 50);
    listener.AwaitFinal(4, 17);
    session->Suspend(absl::UnavailableError("going away"));
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
    return listener.checkpoints();
  }

  // Adds what comes again and what is new; what comes again is the same.
  static void Merge(const Tracks& more, Tracks& tracks) {
    for (const auto& [id, track] : more) {
      for (const auto& [frame, sample] : track) {
        const auto [place, inserted] = tracks[id].emplace(frame, sample);
        EXPECT_TRUE(place->second == sample) << "point " << id << ", frame " << frame;
      }
    }
  }

  // Says everything again from the newest checkpoint on, up to 'end'; without a checkpoint, from the beginning.
  std::unique_ptr<EngineSession> Resume(SessionConfig config, const std::vector<Checkpoint>& checkpoints,
                                        RecordingListener& listener, int64_t end) {
    int64_t begin = 0;
    if (!checkpoints.empty()) {
      config.resume_token = checkpoints.back().token;
      begin = checkpoints.back().next_frame;
    }
    auto session = Open(config, listener);
    EXPECT_EQ(session->accepted().first_frame, begin);
    Say(*session, listener, begin, end);
    return session;
  }

  // The newest, for whoever looks for a difference.
  std::string Describe(const std::vector<Checkpoint>& checkpoints) const {
    if (checkpoints.empty()) return "no checkpoint";
    const SessionState state = *sealer_.Unseal(checkpoints.back().token);
    std::string text = absl::StrCat("checkpoint of frame ", state.taken_frame, ", on with ", state.next_frame, ":");
    for (const SessionState::Track& track : state.tracks) {
      absl::StrAppend(&text, " ", track.state.seed.query.id, "@", track.state.seed.frame, " covered ",
                      track.state.covered, track.state.ending ? " ending" : "");
    }
    return text;
  }

  MemorySealer sealer_;
  int64_t points_ = 0;
};

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

TEST_F(ResumeTest, ManyInterruptionsOfOneStreamChangeNothing) {
  const SessionConfig config = MakeConfig();
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

TEST_F(ResumeTest, EarlierFramesAreIgnored) {
  const SessionConfig config = MakeConfig();
  const Tracks expected = Uninterrupted(config);
  RecordingListener first, second;
  SuspendAt50(first);
  const int64_t encoded = counts_->frames;
  SessionConfig resumed = config;
  resumed.resume_token = first.checkpoints().back().token;
  const int64_t next = first.checkpoints().back().next_frame;
  ASSERT_GT(next, 10);
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

// What a token may not be used for.
class MismatchTest : public ResumeTest {
 protected:
  // Of a session of 50 frames.
  SessionState Saved() {
    RecordingListener listener;
    SuspendAt50(listener);
    return *sealer_.Unseal(listener.checkpoints().back().token);
  }
  absl::Status Try(const SessionState& state, SessionConfig config = MakeConfig()) {
    RecordingListener listener;
    config.resume_token = sealer_.Forge(state);
    return engine().OpenSession(config, listener).status();
  }
};

TEST_F(MismatchTest, OtherWeightsAndOptionsAreNamed) {
  const SessionState state = Saved();
  EXPECT_THAT(Try(state), IsOk());
  SessionState weights = state;
  weights.weights_sha256 = "abc";
  EXPECT_THAT(Try(weights), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("weights abc")));
  const auto refused = [](absl::string_view text) {
    return StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(std::string(text)));
  };
  SessionConfig config = MakeConfig();
  config.processing_size = {64, 64};
  EXPECT_THAT(Try(state, config), refused("processing_size 128x96, this session has 64x64"));
  config = MakeConfig();
  config.raw_size = {64, 64};
  EXPECT_THAT(Try(state, config), refused("frames of 128x96"));
  config = MakeConfig(/*hop=*/4);
  EXPECT_THAT(Try(state, config), refused("hop_frames 8"));
  config.max_hop_frames = 6;
  EXPECT_THAT(Try(state, config), refused("hop_frames 8, this session has 4 .. 6"));
  config = MakeConfig();
  config.iterations = 9;
  EXPECT_THAT(Try(state, config), refused("iterations"));
  config = MakeConfig();
  config.polish = false;
  EXPECT_THAT(Try(state, config), refused("polish on, this session has off"));
  config = MakeConfig();
  config.encoding = FrameEncoding::kRgb24;
  EXPECT_THAT(Try(state, config), refused("another encoding"));
}

TEST_F(MismatchTest, OptionsLeftOpenAreThoseOfTheToken) {
  const SessionState state = Saved();
  SessionConfig config = MakeConfig();
  config.processing_size = {};
  config.hop_frames = 0;
  config.resume_token = sealer_.Forge(state);
  RecordingListener listener;
  auto session = Open(config, listener);
  EXPECT_EQ(session->accepted().processing_size, kPicture);
  EXPECT_EQ(session->accepted().hop_frames, 8);
  EXPECT_EQ(session->accepted().first_frame, state.next_frame);
}

TEST_F(MismatchTest, ASessionKeepsTheHopThatWasChosenForIt) {
  SessionConfig config = MakeConfig(/*hop=*/4);
  config.max_hop_frames = 16;
  config.resume_token = sealer_.Forge(Saved());
  RecordingListener listener;
  EXPECT_EQ(Open(config, listener)->accepted().hop_frames, 8) << "though there is time for 4";
}

TEST_F(MismatchTest, ImpossibleStatesAreRefused) {
  const SessionState state = Saved();
  ASSERT_THAT(Try(state), IsOk());
  constexpr int64_t kFar = std::numeric_limits<int64_t>::max();
  using Break = std::function<void(SessionState&)>;
  const std::vector<Break> breaks = {
      [](SessionState& s) { s.frame_size = {}; },
      [](SessionState& s) { s.next_frame = -1; },
      [](SessionState& s) { s.taken_frame = s.next_frame - 1; },
      [](SessionState& s) {
        s.next_frame += 30;
        s.taken_frame += 30;
      },
      [](SessionState& s) { s.next_serial = 0; },
      [](SessionState& s) { s.tracks.push_back(s.tracks[0]); },
      [](SessionState& s) { s.tracks[0].state.seed.feature.clear(); },
      [](SessionState& s) { s.tracks[0].state.seed.feature.push_back(1); },
      // All templates alike, but of another length than those that the network samples.
      [](SessionState& s) {
        for (SessionState::Track& track : s.tracks) track.state.seed.feature.push_back(1);
      },
      [](SessionState& s) {
        for (SessionState::Track& track : s.tracks) track.state.seed.feature.pop_back();
      },
      [](SessionState& s) { s.tracks[0].state.seed.frame = -5; },
      [](SessionState& s) { s.tracks[0].state.covered = kFar; },
      [](SessionState& s) { ++s.tracks[0].state.covered; },
      [](SessionState& s) { ++s.tracks[0].state.next_start; },
      [](SessionState& s) { s.tracks[0].state.next_start = -8; },
      [](SessionState& s) { s.tracks[0].state.next_start += 8000; },
      [](SessionState& s) { s.tracks[0].state.estimates.clear(); },
      [](SessionState& s) { s.tracks[0].state.estimates.pop_back(); },
      [](SessionState& s) { s.tracks[0].state.first_kept = kFar; },
      [](SessionState& s) { s.tracks[0].state.final_before = kFar; },
      [](SessionState& s) { s.tracks[0].state.final_before = 0; },
      [](SessionState& s) { s.tracks[0].state.reportable_before += 2000; },
      [](SessionState& s) { s.tracks[0].state.reportable_before = 0; },
      [](SessionState& s) { s.tracks[0].state.sent_before = -1; },
      [](SessionState& s) { s.tracks[0].state.sent_before += 2000; },
      [](SessionState& s) {
        s.tracks[0].state.ending = TrackState::Ending{kFar, kFar};
      },
  };
  for (size_t i = 0; i < breaks.size(); ++i) {
    SessionState broken = state;
    breaks[i](broken);
    EXPECT_THAT(Try(broken), StatusIs(absl::StatusCode::kFailedPrecondition)) << "number " << i;
  }
}

TEST_F(MismatchTest, MorePointsThanTheServerAllowsAreRefused) {
  SessionState state = Saved();
  SessionState::Track more = state.tracks.back();
  for (int i = 0; i <= options_.limits.max_points; ++i) {
    more.state.seed.query.id = static_cast<PointId>(1000 + i);
    more.state.seed.serial = ++state.next_serial;
    state.tracks.push_back(more);
  }
  ++state.next_serial;
  EXPECT_THAT(Try(state), StatusIs(absl::StatusCode::kResourceExhausted));
}

}  // namespace
}  // namespace holdfast
