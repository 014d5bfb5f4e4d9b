// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/state_convert.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include "tests/server/checkpoint/random_state.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

namespace v1 = checkpoint::v1;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Through the bytes too, as a token goes.
absl::StatusOr<SessionState> ThereAndBack(const SessionState& state) {
  v1::SessionState message;
  EXPECT_TRUE(message.ParseFromString(ToProto(state).SerializeAsString()));
  return FromProto(message);
}

void ExpectSurvives(const SessionState& state) {
  const absl::StatusOr<SessionState> back = ThereAndBack(state);
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(StateBits::Of(*back), StateBits::Of(state));
}

TEST(StateConvertTest, EveryBitSurvives) {
  RandomState random(1);
  for (int round = 0; round < 40; ++round) {
    ExpectSurvives(random.Session({/*tracks=*/round % 7, /*channels=*/1 << (round % 5), /*patches=*/round % 2 == 0}));
  }
}

TEST(StateConvertTest, ManyTracksSurvive) { ExpectSurvives(RandomState(2).Session({2048, 32, false})); }

TEST(StateConvertTest, NumbersAtTheEdgeSurvive) {
  SessionState state = RandomState(3).Session({});
  float odd_nan = 0;  // a NaN whose lower bits say something
  const uint32_t bits = 0xffc12345;
  std::memcpy(&odd_nan, &bits, sizeof(bits));
  EstimateState& estimate = state.tracks[0].state.estimates[0];
  estimate.visibility_logit = odd_nan;
  estimate.similarity = -0.F;
  estimate.last_step = kInfinity;
  estimate.position = {-0.F, std::numeric_limits<float>::denorm_min()};
  estimate.shown = {0.F, std::numeric_limits<float>::denorm_min()};  // equal as numbers, another one in bits
  state.tracks[1].state.seed.feature[0] = kNan;
  state.tracks[1].state.seed.query.id = ~uint64_t{0};
  state.tracks[2].state.ending = TrackState::Ending{-1, 0};
  state.tracks[2].state.previous.reset();
  state.taken_frame = -1;
  state.next_frame = 0;
  ExpectSurvives(state);
}

TEST(StateConvertTest, ASessionThatHasSeenNothingSurvives) {
  SessionState state;
  state.processing_size = {512, 384};
  state.hop_frames = 8;
  state.iterations = 4;
  ExpectSurvives(state);
}

TEST(StateConvertTest, PositionsThatAreShownWhereTheyAreTakeNoRoom) {
  SessionState state = RandomState(4).Session({1});
  for (EstimateState& estimate : state.tracks[0].state.estimates) estimate.shown = estimate.position;
  EXPECT_EQ(ToProto(state).tracks(0).shown_x_size(), 0);
  state.tracks[0].state.estimates[2].shown.x += 1;
  EXPECT_EQ(ToProto(state).tracks(0).shown_x_size(), 3);
  ExpectSurvives(state);
}

struct Spoiled {
  const char* says;
  std::function<void(v1::SessionState&)> spoil;
};

void ExpectRefused(const std::vector<Spoiled>& cases) {
  const v1::SessionState good = ToProto(RandomState(5).Session({2, 8, true}));
  ASSERT_THAT(FromProto(good), IsOk());
  for (const Spoiled& spoiled : cases) {
    v1::SessionState message = good;
    spoiled.spoil(message);
    EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(spoiled.says)));
  }
}

TEST(StateConvertTest, SessionsThatCannotBeAreRefused) {
  ExpectRefused({
      {"checksum", [](auto& m) { m.set_weights_sha256(std::string(129, 'a')); }},
      {"encoding", [](auto& m) { m.set_encoding(v1::FRAME_ENCODING_UNSPECIFIED); }},
      {"encoding", [](auto& m) { m.set_encoding(static_cast<v1::FrameEncoding>(6)); }},
      {"size of frames", [](auto& m) { m.set_frame_height(1U << 31); }},
      {"out of range", [](auto& m) { m.set_processing_width(0); }},
      {"out of range", [](auto& m) { m.set_hop_frames(0); }},
      {"out of range", [](auto& m) { m.set_iterations(~0U); }},
      {"next frame", [](auto& m) { m.set_next_frame(-1); }},
      {"next frame", [](auto& m) { m.set_next_frame(std::numeric_limits<int64_t>::max()); }},
      {"frame taken", [](auto& m) { m.set_taken_frame(-2); }},
      {"summary", [](auto& m) { m.set_summary_final_samples(-1); }},
      {"summary", [](auto& m) { m.set_summary_final_samples(std::numeric_limits<int64_t>::max()); }},
      {"summary", [](auto& m) { m.set_summary_points(std::numeric_limits<int64_t>::max()); }},
      {"next serial", [](auto& m) { m.set_next_serial(std::numeric_limits<uint64_t>::max()); }},
      {"track 1: its serial", [](auto& m) { m.mutable_tracks(1)->set_serial(0); }},
      {"track 1: its serial", [](auto& m) { m.set_next_serial(1); }},
      {"track 1: its template", [](auto& m) { m.mutable_tracks(1)->add_feature(1); }},
  });
}

TEST(StateConvertTest, TracksThatCannotBeAreRefused) {
  const auto track = [](auto spoil) { return [spoil](v1::SessionState& m) { spoil(*m.mutable_tracks(1)); }; };
  ExpectRefused({
      {"position is not finite", track([](auto& t) { t.mutable_query()->set_x(kNan); })},
      {"position is not finite", track([](auto& t) { t.mutable_position()->set_y(kInfinity); })},
      {"position is not finite", track([](auto& t) { t.mutable_previous()->set_y(-kInfinity); })},
      {"cannot have deformed", track([](auto& t) { t.mutable_deformation()->set_xx(kNan); })},
      {"cannot have deformed", track([](auto& t) { t.mutable_deformation()->Clear(); })},
      {"before its query", track([](auto& t) { t.set_query_frame(-1); })},
      {"before its query", track([](auto& t) { t.set_first_kept(t.query_frame() - 1); })},
      {"before its query", track([](auto& t) { t.set_first_kept(std::numeric_limits<int64_t>::max()); })},
      {"next window", track([](auto& t) { t.set_next_start(t.first_kept() - 1); })},
      {"next window", track([](auto& t) { t.set_next_start(std::numeric_limits<int64_t>::max()); })},
      {"next window", track([](auto& t) { t.set_covered(t.query_frame() - 1); })},
      {"not in their order", track([](auto& t) { t.set_final_before(t.first_kept() + 100); })},
      {"not in their order", track([](auto& t) { t.set_reportable_before(t.final_before() + 1); })},
      {"not in their order", track([](auto& t) { t.set_sent_before(t.reportable_before() + 1); })},
      {"not in their order", track([](auto& t) { t.set_sent_before(t.first_kept() - 1); })},
      {"no number of windows", track([](auto& t) { t.set_lost_windows(-1); })},
      {"ends at no frame", track([](auto& t) { t.mutable_ending()->set_stop(-2); })},
      {"ends at no frame", track([](auto& t) { t.mutable_ending()->set_last_frame(int64_t{1} << 61); })},
      {"patch is too large",
       track([](auto& t) { t.mutable_patch()->set_code(std::string(FlowPatch::kMaxCodeBytes + 1, 'x')); })},
      {"patch's position", track([](auto& t) { t.mutable_patch()->mutable_at()->set_x(kNan); })},
  });
}

TEST(StateConvertTest, EstimatesThatCannotBeAreRefused) {
  const auto track = [](auto spoil) { return [spoil](v1::SessionState& m) { spoil(*m.mutable_tracks(0)); }; };
  ExpectRefused({
      {"no estimates", track([](auto& t) { t.clear_position_x(); })},
      {"equally many", track([](auto& t) { t.mutable_position_y()->RemoveLast(); })},
      {"equally many", track([](auto& t) { t.add_visibility_logit(1); })},
      {"equally many", track([](auto& t) { t.add_similarity(1); })},
      {"equally many", track([](auto& t) { t.clear_last_step(); })},
      {"equally many", track([](auto& t) { t.add_polish(v1::POLISH_NOT_FOUND); })},
      {"equally many", track([](auto& t) { t.add_seen(true); })},
      {"more shown", track([](auto& t) { t.add_shown_y(1); })},
      {"more shown", track([](auto& t) {
         for (int i = 0; i < 40; ++i) {
           t.add_shown_x(1);
           t.add_shown_y(1);
         }
       })},
      {"position is not finite", track([](auto& t) { t.set_position_x(3, kNan); })},
      {"position is not finite", track([](auto& t) { t.set_shown_y(0, kInfinity); })},
      {"polish is unknown", track([](auto& t) { t.set_polish(1, static_cast<v1::Polish>(4)); })},
  });
}

TEST(StateConvertTest, ObjectsSurvive) {
  RandomState random(8);
  for (int round = 0; round < 20; ++round) ExpectSurvives(random.Session({2, 8, false, 1 + round % 3}));
}

TEST(StateConvertTest, ObjectsThatCannotBeAreRefused) {
  const v1::SessionState good = ToProto(RandomState(9).Session({1, 8, false, 2}));
  ASSERT_THAT(FromProto(good), IsOk());
  const std::vector<Spoiled> cases = {
      {"object 1: its id", [](auto& m) { m.mutable_objects(1)->set_id(1U << 31); }},
      {"its frames", [](auto& m) { m.mutable_objects(0)->set_next(-1); }},
      {"its frames", [](auto& m) { m.mutable_objects(0)->set_next(std::numeric_limits<int64_t>::max()); }},
      {"not finite", [](auto& m) { m.mutable_objects(0)->mutable_centre()->set_x(kNan); }},
      {"not finite", [](auto& m) { m.mutable_objects(0)->set_motion_b(kInfinity); }},
      {"number of values", [](auto& m) { m.mutable_objects(0)->add_outline_x(1); }},
      {"no points", [](auto& m) { m.mutable_objects(0)->clear_members(); }},
      {"is none", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->set_point_id(5); }},
      {"equally many", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->add_sample_x(5); }},
      {"out of range", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->set_end(-5); }},
      {"its first frame", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->set_queried(3); }},
      {"its first frame", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->set_queried(m.objects(0).next()); }},
      {"contrary", [](auto& m) { m.mutable_objects(0)->mutable_members(0)->set_contrary(~0U); }},
  };
  for (const Spoiled& spoiled : cases) {
    v1::SessionState message = good;
    spoiled.spoil(message);
    EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(spoiled.says)));
  }
}

}  // namespace
}  // namespace holdfast
