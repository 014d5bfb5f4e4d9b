// SPDX-License-Identifier: Apache-2.0
// Tokens that do not fit the server or the session that they are shown to.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/server/engine/resume_fixture.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

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
  SessionState steps = state;
  steps.least_step = 1.5;
  EXPECT_THAT(Try(steps), refused("least_step 1.5, this session has 0.5"));
  steps.least_step.reset();
  EXPECT_THAT(Try(steps), IsOk()) << "an older token does not say";
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
      [](SessionState& s) { s.taken_frame = s.next_frame + (1 << 20); },
      [](SessionState& s) { s.taken_frame = kFar - 1; },
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
