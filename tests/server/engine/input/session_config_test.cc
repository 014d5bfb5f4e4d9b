// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/session_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "api/errors.h"
#include "tests/support/status_matchers.h"
#include "tests/support/violated_fields.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(SessionConfigTest, FillsInTheDefaults) {
  const auto accepted = Negotiate({}, {}, {});
  ASSERT_THAT(accepted, IsOk());
  EXPECT_EQ(accepted->processing_size, (ImageSize{512, 384}));
  EXPECT_EQ(accepted->hop_frames, 8);
  EXPECT_EQ(accepted->iterations, 4);
  EXPECT_EQ(accepted->window_frames, 24);
}

TEST(SessionConfigTest, TheDefaultProcessingSizeStandsAsTheFramesDo) {
  const auto processed = [](ImageSize frame_size, ImageSize raw_size, ImageSize standard, ImageSize wanted = {}) {
    SessionConfig config;
    config.encoding = raw_size.empty() ? FrameEncoding::kJpeg : FrameEncoding::kRgb24;
    config.frame_size = frame_size;
    config.raw_size = raw_size;
    config.processing_size = wanted;
    EngineOptions options;
    options.processing_size = standard;
    return Negotiate(config, options, {})->processing_size;
  };
  const ImageSize lying{512, 384}, upright{384, 512}, square{384, 384};
  EXPECT_EQ(processed({480, 854}, {}, lying), upright);
  EXPECT_EQ(processed({854, 480}, {}, lying), lying);
  EXPECT_EQ(processed({854, 480}, {}, upright), lying);
  EXPECT_EQ(processed({480, 480}, {}, lying), lying);
  EXPECT_EQ(processed({480, 854}, {}, square), square);
  EXPECT_EQ(processed({}, {}, lying), lying);
  EXPECT_EQ(processed({}, {480, 854}, lying), upright);
  EXPECT_EQ(processed({854, 480}, {480, 854}, lying), upright) << "raw_size is exact";
  EXPECT_EQ(processed({480, 854}, {}, lying, {640, 384}), (ImageSize{640, 384})) << "what is asked for is taken";
}

TEST(SessionConfigTest, NamesEveryFieldThatIsWrong) {
  SessionConfig config;
  config.raw_size = {10, 10};
  config.processing_size = {100, 64};
  config.hop_frames = 24;
  config.iterations = 17;
  config.label = std::string(129, 'x');
  config.points = {{1, -5, 0}};
  EXPECT_THAT(ViolatedFields(Negotiate(config, {}, {}).status()),
              ElementsAre("config.raw_size", "config.processing_size", "config.hop_frames", "config.iterations",
                          "config.label", "config.points[0].x"));
}

TEST(SessionConfigTest, NamesAFieldThatIsWrongAlone) {
  const auto fields_of = [](auto spoil) {
    SessionConfig config;
    config.points = {{1, 2, 3}, {4, 5, 6}};
    spoil(config);
    return ViolatedFields(Negotiate(config, {}, {}).status());
  };
  EXPECT_THAT(fields_of([](auto&) {}), IsEmpty());
  EXPECT_THAT(fields_of([](auto& c) { c.encoding = FrameEncoding::kRgb24; }), ElementsAre("config.raw_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.raw_size = {8, 0}; }), ElementsAre("config.raw_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.processing_size = {500, 384}; }), ElementsAre("config.processing_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.processing_size = {512, 0}; }), ElementsAre("config.processing_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.label = std::string(129, 'x'); }), ElementsAre("config.label"));
  for (const double rate : {-1.0, std::nan(""), 1001.0, std::numeric_limits<double>::infinity()}) {
    EXPECT_THAT(fields_of([rate](auto& c) { c.frames_per_second = rate; }), ElementsAre("config.frames_per_second"));
  }
  EXPECT_THAT(fields_of([](auto& c) { c.expected_points = -1; }), ElementsAre("config.expected_points"));
  EXPECT_THAT(fields_of([](auto& c) { c.expected_points = 2049; }), ElementsAre("config.expected_points"));
  EXPECT_THAT(fields_of([](auto& c) { c.points[1].x = std::nanf(""); }), ElementsAre("config.points[1].x"));
  EXPECT_THAT(fields_of([](auto& c) { c.points[0].y = std::numeric_limits<float>::infinity(); }),
              ElementsAre("config.points[0].y"));
  EXPECT_THAT(fields_of([](auto& c) { c.points[0].x = -1; }), ElementsAre("config.points[0].x"));
  EXPECT_THAT(fields_of([](auto& c) { c.points[1].id = c.points[0].id; }), ElementsAre("config.points[1].id"));
  EXPECT_THAT(fields_of([](auto& c) {
                c.emit = Emit::kEveryFrame;
                c.send_provisional = false;
              }),
              ElementsAre("config.emit"));
}

TEST(SessionConfigTest, CheckpointsComeNoMoreOftenThanWindowsEnd) {
  const auto interval = [](int wanted, int hop) {
    SessionConfig config;
    config.checkpoint_interval_frames = wanted;
    config.hop_frames = hop;
    return Negotiate(config, {}, {})->checkpoint_interval_frames;
  };
  EXPECT_EQ(interval(1, 4), 4);
  EXPECT_EQ(interval(1, 0), 8) << "the default hop";
  EXPECT_EQ(interval(5, 4), 5);
  EXPECT_EQ(interval(0, 4), 0) << "only before a planned end";
}

TEST(SessionConfigTest, WantsTheSizeOfRawFramesAndChecksPointsAgainstIt) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  EXPECT_THAT(ViolatedFields(Negotiate(config, {}, {}).status()), ElementsAre("config.raw_size"));
  config.raw_size = {100000, 100000};
  EXPECT_THAT(Negotiate(config, {}, {}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("100000x100000")));
  config.raw_size = {64, 48};
  EngineOptions options;
  options.limits.max_frame_bytes = 64 * 48 * 3 - 1;
  EXPECT_THAT(Negotiate(config, options, {}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("9216 bytes")));
  config.encoding = FrameEncoding::kGray8;
  EXPECT_THAT(Negotiate(config, options, {}), IsOk());
  config.points = {{1, 63, 47}, {2, 64, 47}};
  EXPECT_THAT(ViolatedFields(Negotiate(config, {}, {}).status()), ElementsAre("config.points[1].x"));
}

TEST(SessionConfigTest, BoundsTheProcessingSizeAndThePoints) {
  EngineOptions options;
  options.max_processing_pixels = 64 * 64;
  options.limits.max_points = 1;
  SessionConfig config;
  config.processing_size = {64, 96};
  EXPECT_THAT(ViolatedFields(Negotiate(config, options, {}).status()), ElementsAre("config.processing_size"));
  config.processing_size = {64, 64};
  config.points = {{1}, {2}};
  EXPECT_THAT(Negotiate(config, options, {}), StatusIs(absl::StatusCode::kResourceExhausted));
  config.points = {{1, -1}, {1, -1}};
  EXPECT_THAT(Negotiate(config, options, {}), StatusIs(absl::StatusCode::kResourceExhausted))
      << "counted before anything else";
}

TEST(SessionConfigTest, ASessionMayHaveFewerPointsThanTheEngineAllowsButNotMore) {
  EngineOptions options;
  options.limits.max_points = 3;
  SessionConfig config;
  config.points = {{1}, {2}};
  EXPECT_EQ(Negotiate(config, options, {})->limits.max_points, 3);
  config.max_points = 2;
  EXPECT_EQ(Negotiate(config, options, {})->limits.max_points, 2);
  config.max_points = 1;
  EXPECT_THAT(Negotiate(config, options, {}), StatusIs(absl::StatusCode::kResourceExhausted));
  config.max_points = 1000;
  EXPECT_EQ(Negotiate(config, options, {})->limits.max_points, 3);
  config.max_points = 2;
  config.expected_points = 3;
  EXPECT_THAT(ViolatedFields(Negotiate(config, options, {}).status()), ElementsAre("config.expected_points"));
}

TEST(SessionConfigTest, NamesTheFirstViolationsAndCountsTheRest) {
  SessionConfig config;
  config.hop_frames = 24;
  config.label = std::string(200, 'x');
  for (PointId id = 0; id < 1000; ++id) config.points.push_back({id, -1, -1});
  for (PointId id = 0; id < 1000; ++id) config.points.push_back({id, std::nanf(""), 1});
  const absl::Status status = Negotiate(config, {}, {}).status();
  EXPECT_EQ(ViolatedFields(status).size(), kMaxFieldViolations);
  // The hop, the label, two thousand coordinates below 0, a thousand that are no numbers, a thousand ids given twice.
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("; and 3994 more")));
}

TEST(SessionConfigTest, TheSwitchesOfOpticalFlowFollowTheEngineUnlessTheSessionSaysOtherwise) {
  EngineOptions options;
  options.polish = false;
  EXPECT_TRUE(Negotiate({}, options, {})->motion_prior);
  EXPECT_FALSE(Negotiate({}, options, {})->polish);
  SessionConfig config;
  config.motion_prior = false;
  config.polish = true;
  config.emit = Emit::kEveryFrame;
  EXPECT_FALSE(Negotiate(config, options, {})->motion_prior);
  EXPECT_TRUE(Negotiate(config, options, {})->polish);
  EXPECT_EQ(Negotiate(config, options, {})->emit, Emit::kEveryFrame);
  options.chaining = Chaining::kPublished;
  EXPECT_THAT(ViolatedFields(Negotiate(config, options, {}).status()), ElementsAre("config.polish"));
}

TEST(SessionConfigTest, BeginsWithTheLeastHopOfTheBoundsAndTakesAnotherOne) {
  SessionConfig config;
  config.max_hop_frames = 23;
  config.checkpoint_interval_frames = 10;
  const auto accepted = Negotiate(config, {}, {});
  ASSERT_THAT(accepted, IsOk());
  EXPECT_EQ(accepted->hop_frames, 8);
  EXPECT_EQ(accepted->checkpoint_interval_frames, 10);
  EXPECT_EQ(WithHop(*accepted, config, 12).hop_frames, 12);
  EXPECT_EQ(WithHop(*accepted, config, 12).checkpoint_interval_frames, 12) << "no more often than windows end";
  config.max_hop_frames = 6;
  EXPECT_EQ(Negotiate(config, {}, {})->hop_frames, 6) << "the default is larger";
  config.hop_frames = 2;
  EXPECT_EQ(Negotiate(config, {}, {})->hop_frames, 2);
}

TEST(SessionConfigTest, ABoundOfTheHopIsNotBelowItNorAWindow) {
  SessionConfig config;
  for (const auto& [least, most] : {std::pair{8, 7}, {8, 24}, {0, 24}, {0, -1}}) {
    config.hop_frames = least;
    config.max_hop_frames = most;
    EXPECT_THAT(ViolatedFields(Negotiate(config, {}, {}).status()), ElementsAre("config.max_hop_frames"));
  }
  config.hop_frames = 8;
  config.max_hop_frames = 4;
  EXPECT_THAT(Negotiate(config, {}, {}).status().message(), HasSubstr("4 is not in 8 .. 23"));
}

TEST(SessionConfigTest, ThePublishedChainingHasOneHop) {
  EngineOptions options;
  options.chaining = Chaining::kPublished;
  EXPECT_EQ(Negotiate({}, options, {})->hop_frames, 23);
  SessionConfig config;
  config.hop_frames = 8;
  EXPECT_THAT(ViolatedFields(Negotiate(config, options, {}).status()), ElementsAre("config.hop_frames"));
}

TEST(EngineOptionsTest, RefusesWhatCannotWork) {
  EXPECT_THAT(EngineOptions().Validate(), IsOk());
  EngineOptions options;
  options.max_batch_rows = 0;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("max_batch_rows is 0")));
  options = {};
  options.least_step = -1;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("least_step is -1")));
  options = {};
  options.processing_size = {500, 384};
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("500x384")));
}

}  // namespace
}  // namespace holdfast
