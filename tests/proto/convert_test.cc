// SPDX-License-Identifier: Apache-2.0
#include "proto/convert.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

#include "api/errors.h"
#include "tests/support/status_matchers.h"
#include "tests/support/violated_fields.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

v1::SessionConfig GoodConfig() {
  SessionConfig config;
  config.points = {{1, 2, 3}, {4, 5, 6}};
  return ToProto(config);
}

TEST(ConvertTest, ConfigSurvivesTheRoundTrip) {
  SessionConfig config;
  config.encoding = FrameEncoding::kBgr24;
  config.raw_size = {641, 479};
  config.frame_size = {480, 854};
  config.processing_size = {512, 384};
  config.hop_frames = 5;
  config.max_hop_frames = 11;
  config.iterations = 6;
  config.send_provisional = false;
  config.points = {{~PointId{0}, 1.5F, 2.25F}, {0, 0, 0}};
  config.label = "camera 3";
  config.motion_prior = false;
  config.polish = true;
  const absl::StatusOr<SessionConfig> back = FromProto(ToProto(config));
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->encoding, config.encoding);
  EXPECT_EQ(back->raw_size, config.raw_size);
  EXPECT_EQ(back->frame_size, config.frame_size);
  EXPECT_EQ(back->processing_size, config.processing_size);
  EXPECT_EQ(back->hop_frames, 5);
  EXPECT_EQ(back->max_hop_frames, 11);
  EXPECT_EQ(back->iterations, 6);
  EXPECT_FALSE(back->send_provisional);
  ASSERT_THAT(back->points, SizeIs(2));
  EXPECT_EQ(back->points[0].id, ~PointId{0});
  EXPECT_EQ(back->points[0].x, 1.5F);
  EXPECT_EQ(back->points[0].y, 2.25F);
  EXPECT_EQ(back->label, "camera 3");
  EXPECT_EQ(back->emit, Emit::kWindows);
  EXPECT_EQ(back->motion_prior, false);
  EXPECT_EQ(back->polish, true);
}

TEST(ConvertTest, AnEstimateOnEveryFrameIsAskedForAndSwitchesMayBeLeftToTheServer) {
  SessionConfig config;
  config.emit = Emit::kEveryFrame;
  const absl::StatusOr<SessionConfig> back = FromProto(ToProto(config));
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->emit, Emit::kEveryFrame);
  EXPECT_FALSE(back->motion_prior.has_value());
  EXPECT_FALSE(back->polish.has_value());
}

TEST(ConvertTest, EveryEncodingSurvivesTheRoundTrip) {
  for (const FrameEncoding encoding : {FrameEncoding::kJpeg, FrameEncoding::kPng, FrameEncoding::kRgb24,
                                       FrameEncoding::kBgr24, FrameEncoding::kGray8}) {
    SessionConfig config;
    config.encoding = encoding;
    if (IsRaw(encoding)) config.raw_size = {8, 8};
    const auto back = FromProto(ToProto(config));
    ASSERT_THAT(back, IsOk());
    EXPECT_EQ(back->encoding, encoding);
  }
}

TEST(ConvertTest, EveryWrongFieldOfAConfigIsNamed) {
  const auto fields_of = [](auto spoil) {
    v1::SessionConfig config = GoodConfig();
    spoil(config);
    return ViolatedFields(FromProto(config).status());
  };
  EXPECT_THAT(fields_of([](auto& c) { c.clear_encoding(); }), ElementsAre("config.encoding"));
  EXPECT_THAT(fields_of([](auto& c) { c.set_encoding(static_cast<v1::FrameEncoding>(99)); }),
              ElementsAre("config.encoding"));
  EXPECT_THAT(fields_of([](auto& c) { c.set_emit(static_cast<v1::Emit>(2)); }), ElementsAre("config.emit"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_raw_size()->set_width(8); }), ElementsAre("config.raw_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_frame_size()->set_width(8); }), ElementsAre("config.frame_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_processing_size()->set_width(512); }),
              ElementsAre("config.processing_size"));
  EXPECT_THAT(fields_of([](auto& c) {
                c.mutable_processing_size()->set_width(65536 + 32);
                c.mutable_processing_size()->set_height(384);
              }),
              ElementsAre("config.processing_size"));
  EXPECT_THAT(fields_of([](auto& c) { c.set_hop_frames(4'000'000'000); }), ElementsAre("config.hop_frames"));
  EXPECT_THAT(fields_of([](auto& c) { c.set_iterations(4'000'000'000); }), ElementsAre("config.iterations"));
}

TEST(ConvertTest, SeveralMistakesAreReportedTogether) {
  v1::SessionConfig config = GoodConfig();
  config.clear_encoding();
  config.set_iterations(1U << 31);
  EXPECT_THAT(ViolatedFields(FromProto(config).status()), ElementsAre("config.encoding", "config.iterations"));
}

TEST(ConvertTest, WhatOnlyTheEngineCanJudgeIsPassedOnAsItIs) {
  v1::SessionConfig config = GoodConfig();
  config.set_encoding(v1::FRAME_ENCODING_RGB24);  // without the size of the frames
  config.mutable_processing_size()->set_width(33);
  config.mutable_processing_size()->set_height(5);
  config.set_emit(v1::EMIT_EVERY_FRAME);
  config.set_final_only(true);
  config.set_label(std::string(1000, 'x'));
  *config.mutable_points(1) = config.points(0);
  config.mutable_points(1)->set_x(-1);
  const absl::StatusOr<SessionConfig> plain = FromProto(config);
  ASSERT_THAT(plain, IsOk());
  EXPECT_TRUE(plain->raw_size.empty());
  EXPECT_TRUE(plain->frame_size.empty());
  EXPECT_EQ(plain->processing_size, (ImageSize{33, 5}));
  EXPECT_EQ(plain->emit, Emit::kEveryFrame);
  EXPECT_FALSE(plain->send_provisional);
  EXPECT_EQ(plain->label.size(), 1000U);
  EXPECT_EQ(plain->points[1].id, plain->points[0].id);
  EXPECT_EQ(plain->points[1].x, -1);
}

TEST(ConvertTest, ListsAreCountedBeforeTheirElementsAreLookedAt) {
  const std::vector<PointQuery> points(kMaxPointsInMessage + 1, {1, -1, std::nanf("")});
  SessionConfig config;
  config.points = points;
  EXPECT_THAT(ViolatedFields(FromProto(ToProto(config)).status()), ElementsAre("config.points"));
  EXPECT_THAT(ViolatedFields(FromProto(ToProto(Frame{0, "x", {}, points})).status()), ElementsAre("frame.points"));
  EXPECT_THAT(FromProto(AddPointsToProto(points)),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("add_points.points: has 65537 elements, expected at most 65536")));
  EXPECT_THAT(ViolatedFields(FromProto(RemovePointsToProto(std::vector<PointId>(kMaxPointsInMessage + 1))).status()),
              ElementsAre("remove_points.ids"));
}

TEST(ConvertTest, FrameSurvivesTheRoundTrip) {
  Frame frame;
  frame.index = 12;
  frame.bytes = std::string("\0\xff jpeg", 7);
  frame.capture_time = absl::FromUnixNanos(-1'500'000'001);
  frame.points = {{9, 1, 2}};
  const auto back = FromProto(ToProto(frame));
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->index, 12);
  EXPECT_EQ(back->bytes, frame.bytes);
  EXPECT_EQ(back->capture_time, frame.capture_time);
  ASSERT_THAT(back->points, SizeIs(1));
  EXPECT_EQ(back->points[0].id, 9U);
}

TEST(ConvertTest, WrongFieldsOfAFrameAreNamed) {
  v1::Frame frame = ToProto(Frame{0, "x", {}, {}});
  frame.mutable_capture_time()->set_nanos(-1);
  frame.clear_data();
  EXPECT_THAT(ViolatedFields(FromProto(std::move(frame)).status()), ElementsAre("frame.capture_time", "frame.data"));
  for (const int64_t seconds : {int64_t{-62135596801}, int64_t{253402300800}}) {
    v1::Frame far = ToProto(Frame{0, "x", {}, {}});
    far.mutable_capture_time()->set_seconds(seconds);
    EXPECT_THAT(ViolatedFields(FromProto(std::move(far)).status()), ElementsAre("frame.capture_time")) << seconds;
  }
}

TEST(ConvertTest, PointsToAddAndRemoveSurviveTheRoundTrip) {
  const auto added = FromProto(AddPointsToProto({{1, 2, 3}}));
  ASSERT_THAT(added, IsOk());
  EXPECT_EQ(added->front().y, 3);
  EXPECT_THAT(FromProto(RemovePointsToProto({5, 6})), IsOkAndHolds(ElementsAre(5U, 6U)));
}

TEST(ConvertTest, ResultsSurviveTheRoundTrip) {
  TrackUpdate update;
  update.runs = {{3, 100, {1, 2}, {3, 4}, {1, 0}, {0.5F, 0.25F}, 1}};
  update.frames_received = 110;
  update.frames_processed = 102;
  update.capture_times = {{100, absl::FromUnixNanos(-1'500'000'001)}, {101, absl::FromUnixMillis(5)}};
  const auto back = FromProto(ToProto(update));
  ASSERT_THAT(back, IsOk());
  ASSERT_THAT(back->runs, SizeIs(1));
  const PointRun& run = back->runs[0];
  EXPECT_EQ(run.id, 3U);
  EXPECT_EQ(run.first_frame, 100);
  EXPECT_THAT(run.x, ElementsAre(1, 2));
  EXPECT_THAT(run.y, ElementsAre(3, 4));
  EXPECT_THAT(run.visible, ElementsAre(1, 0));
  EXPECT_THAT(run.confidence, ElementsAre(0.5F, 0.25F));
  EXPECT_EQ(run.final_count, 1);
  EXPECT_EQ(back->frames_received, 110);
  EXPECT_EQ(back->frames_processed, 102);
  ASSERT_THAT(back->capture_times, SizeIs(2));
  EXPECT_EQ(back->capture_times[0].frame, 100);
  EXPECT_EQ(back->capture_times[0].capture_time, absl::FromUnixNanos(-1'500'000'001));
  EXPECT_EQ(back->capture_times[1].frame, 101);
}

TEST(ConvertTest, ACaptureTimeOutOfRangeIsTheServersFault) {
  v1::Tracks tracks;
  tracks.add_capture_times()->mutable_capture_time()->set_nanos(-1);
  EXPECT_THAT(FromProto(tracks), StatusIs(absl::StatusCode::kInternal));
}

TEST(ConvertTest, ARunOfNoFrameOrBeyondAllFramesIsRefused) {
  EXPECT_THAT(FromProto(ToProto(TrackUpdate{{{3, 0, {}, {}, {}, {}, 0}}, 1, 1})),
              StatusIs(absl::StatusCode::kInternal));
  for (const int64_t first : {std::numeric_limits<int64_t>::max(), int64_t{-1}}) {
    EXPECT_THAT(FromProto(ToProto(TrackUpdate{{{3, first, {1}, {1}, {1}, {1}, 1}}, 1, 1})),
                StatusIs(absl::StatusCode::kInternal));
  }
}

TEST(ConvertTest, RunsOfUnequalLengthsAreRefused) {
  v1::Tracks tracks = ToProto(TrackUpdate{{{3, 0, {1}, {1}, {1}, {1}, 1}}, 1, 1});
  tracks.mutable_runs(0)->add_y(5);
  EXPECT_THAT(FromProto(tracks), StatusIs(absl::StatusCode::kInternal));
  tracks.mutable_runs(0)->mutable_y()->RemoveLast();
  EXPECT_THAT(FromProto(tracks), IsOk());
  tracks.mutable_runs(0)->set_final_count(2);
  EXPECT_THAT(FromProto(tracks), StatusIs(absl::StatusCode::kInternal));
}

TEST(ConvertTest, AcceptedSummaryAndInfoSurviveTheRoundTrip) {
  const SessionLimits limits{10, int64_t{5} << 32, 1000, 77};
  const auto accepted =
      FromProto(ToProto(SessionAccepted{"id", {512, 384}, 8, 4, 24, Emit::kEveryFrame, true, true, limits}));
  ASSERT_THAT(accepted, IsOk());
  EXPECT_EQ(accepted->session_id, "id");
  EXPECT_EQ(accepted->processing_size, (ImageSize{512, 384}));
  EXPECT_EQ(accepted->hop_frames, 8);
  EXPECT_EQ(accepted->window_frames, 24);
  EXPECT_EQ(accepted->emit, Emit::kEveryFrame);
  EXPECT_TRUE(accepted->motion_prior);
  EXPECT_TRUE(accepted->polish);
  EXPECT_EQ(accepted->limits.max_frame_bytes, int64_t{5} << 32);
  EXPECT_EQ(accepted->limits.max_frames, 77);

  const SessionSummary summary = FromProto(ToProto(SessionSummary{1, 2, 3}));
  EXPECT_EQ(summary.frames, 1);
  EXPECT_EQ(summary.points, 2);
  EXPECT_EQ(summary.final_samples, 3);

  TrackerInfo info{"m", "p", "sha", "float32", "cpu", "0.1", {64, 32}, 24,
                   8,   4,   true,  false,     true,  16,    limits,   {3, 70, 12.5, 100, 9}};
  const auto back = FromProto(ToProto(info));
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->model_name, "m");
  EXPECT_EQ(back->weights_sha256, "sha");
  EXPECT_EQ(back->default_processing_size, (ImageSize{64, 32}));
  EXPECT_TRUE(back->default_motion_prior);
  EXPECT_FALSE(back->default_polish);
  EXPECT_TRUE(back->calibrated_confidence);
  EXPECT_EQ(back->max_sessions, 16);
  EXPECT_EQ(back->limits.max_points, 10);
  EXPECT_EQ(back->load.sessions, 3);
  EXPECT_EQ(back->load.points, 70);
  EXPECT_EQ(back->load.work_promised, 12.5);
  EXPECT_EQ(back->load.work_budget, 100);
  EXPECT_EQ(back->load.frame_work, 9);
}

TEST(ConvertTest, AnAcceptanceThatMakesNoSenseIsRefused) {
  EXPECT_THAT(FromProto(v1::SessionAccepted()), StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(FromProto(ToProto(SessionAccepted{"id", {32, 32}, 24, 4, 24, {}})),
              StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(FromProto(v1::GetServerInfoResponse()), StatusIs(absl::StatusCode::kInternal));
}

ObjectQuery Masked() { return {7, "png", {}, 48}; }
ObjectQuery Drawn() { return {kMaxObjectId, "", {{1, 2}, {3.5F, 4}, {5, 6}}, 0}; }

TEST(ConvertTest, ObjectsSurviveTheRoundTrip) {
  SessionConfig config;
  config.objects = {Masked(), Drawn()};
  config.objects[1].reseed = false;
  const absl::StatusOr<SessionConfig> back = FromProto(ToProto(config));
  ASSERT_THAT(back, IsOk());
  ASSERT_THAT(back->objects, SizeIs(2));
  EXPECT_EQ(back->objects[0].mask_png, "png");
  EXPECT_EQ(back->objects[0].points, 48);
  EXPECT_TRUE(back->objects[0].reseed);
  EXPECT_FALSE(back->objects[1].reseed);
  EXPECT_EQ(back->objects[1].id, kMaxObjectId);
  ASSERT_THAT(back->objects[1].polygon, SizeIs(3));
  EXPECT_EQ(back->objects[1].polygon[1].x, 3.5F);
  Frame frame{0, "data", {}, {}, {Masked()}};
  const absl::StatusOr<Frame> frame_back = FromProto(ToProto(frame));
  ASSERT_THAT(frame_back, IsOk());
  ASSERT_THAT(frame_back->objects, SizeIs(1));
  EXPECT_EQ(frame_back->objects[0].id, 7U);
}

TEST(ConvertTest, ObjectsThatAreTooLargeToLookAtAreNamed) {
  const auto fields_of = [](auto spoil) {
    SessionConfig plain;
    plain.objects = {Masked(), Drawn()};
    v1::SessionConfig config = ToProto(plain);
    spoil(config);
    return ViolatedFields(FromProto(config).status());
  };
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_objects(0)->set_id(1U << 31); }), ElementsAre("config.objects[0].id"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_objects(0)->set_points(257); }),
              ElementsAre("config.objects[0].points"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_objects(1)->mutable_polygon()->add_x(1); }),
              ElementsAre("config.objects[1].polygon.y"));
  EXPECT_THAT(fields_of([](auto& c) { c.mutable_objects(0)->set_mask_png(std::string(kMaxObjectBytes, 'x')); }),
              ElementsAre("config.objects"));
  EXPECT_THAT(fields_of([](auto& c) {
                for (int i = 0; i < kMaxObjects; ++i) c.add_objects();
              }),
              ElementsAre("config.objects"));
}

TEST(ConvertTest, WhatIsSaidOfObjectsSurvivesTheRoundTrip) {
  ObjectSample sample{{1, 2},
                      1.5F,
                      -0.25F,
                      0.75F,
                      {{0, 0}, {4, 0}, {4, 4}},
                      {ObjectPointId(7, 3)},
                      {ObjectPointId(7, 258), ObjectPointId(7, 259)}};
  TrackUpdate update;
  update.objects = {{7, 12, {sample, sample}, 1}};
  v1::Tracks message = ToProto(update);
  const absl::StatusOr<TrackUpdate> back = FromProto(message);
  ASSERT_THAT(back, IsOk());
  ASSERT_THAT(back->objects, SizeIs(1));
  EXPECT_EQ(back->objects[0].first_frame, 12);
  EXPECT_EQ(back->objects[0].final_count, 1);
  ASSERT_THAT(back->objects[0].samples, SizeIs(2));
  const ObjectSample& second = back->objects[0].samples[1];
  EXPECT_EQ(second.rotation, -0.25F);
  EXPECT_EQ(second.outline[2].y, 4);
  EXPECT_THAT(second.left, ElementsAre(ObjectPointId(7, 3)));
  EXPECT_THAT(second.joined, ElementsAre(ObjectPointId(7, 258), ObjectPointId(7, 259)));
  message.mutable_objects(0)->set_final_count(3);
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInternal, HasSubstr("object 7")));
  message = ToProto(update);
  message.mutable_objects(0)->mutable_samples(1)->add_outline_x(1);
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInternal));
  message.mutable_objects(0)->clear_samples();
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInternal));
}

}  // namespace
}  // namespace holdfast
