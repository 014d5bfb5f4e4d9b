// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_queries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <vector>

#include "api/limits.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// Two points on frame 2, one on frame 7, and an object on frame 5; frames are sent at half their size.
class TrackQueriesTest : public ::testing::Test {
 protected:
  TrackQueriesTest() {
    options_.start_frame = 2;
    std::vector<uint8_t> png;
    cv::imencode(".png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(255)), png);
    object_.query.mask_png.assign(png.begin(), png.end());
    object_.query.id = 1;
    object_.frame = 5;
    object_.first_point = 10;
  }

  TrackQueries Make(bool with_object = true) {
    const std::vector<StartPoint> points = {{{1, 21, 11}, 2}, {{2, 1, 1}, 7}, {{3, 0, 0}, 2}};
    auto queries = TrackQueries::Create(options_, FrameEncoder({64, 48}, /*max_side=*/32, /*jpeg_quality=*/90), points,
                                        with_object ? std::make_optional(object_) : std::nullopt);
    EXPECT_THAT(queries, IsOk());
    return *std::move(queries);
  }

  TrackOptions options_;
  StartObject object_;
};

TEST_F(TrackQueriesTest, WhatStartsOnTheFirstFrameIsInTheConfigAndTheRestWithItsFrame) {
  const TrackQueries queries = Make();
  EXPECT_THAT(queries.frames(), ElementsAre(2, 5, 7));
  const SessionConfig config = queries.Config();
  EXPECT_EQ(config.frame_size, (ImageSize{32, 24})) << "of what is sent";
  ASSERT_THAT(config.points, SizeIs(2));
  EXPECT_EQ(config.points[0].x, 10.25f) << "in pixels of what is sent";
  EXPECT_THAT(config.objects, IsEmpty());
  EXPECT_THAT(queries.PointsOf(7), SizeIs(1));
  EXPECT_THAT(queries.PointsOf(3), IsEmpty());
  EXPECT_THAT(queries.ObjectsOf(5), SizeIs(1));
  EXPECT_EQ(queries.CountPointsFrom(3), 1u);
  EXPECT_TRUE(queries.ObjectIsFrom(5));
  EXPECT_FALSE(queries.ObjectIsFrom(6));
}

TEST_F(TrackQueriesTest, APaceIsAskedForAllThatWillBeTracked) {
  EXPECT_EQ(Make().Config().expected_points, 0);
  options_.promise_fps = 5;
  EXPECT_EQ(Make(/*with_object=*/false).Config().expected_points, 3);
  EXPECT_EQ(Make().Config().expected_points, 3 + kDefaultObjectPoints);
  object_.query.points = 9;
  EXPECT_EQ(Make().Config().expected_points, 3 + 9);
  EXPECT_EQ(Make().BackwardConfig(4).expected_points, 4);
}

TEST_F(TrackQueriesTest, PointsOfTheObjectGetTheIdsOfOutputs) {
  TrackUpdate update;
  update.runs.resize(2);
  update.runs[0].id = ObjectPointId(1, 3);
  update.runs[1].id = 3;
  update.objects.resize(1);
  update.objects[0].samples.resize(1);
  update.objects[0].samples[0].left = {ObjectPointId(1, 0)};
  TrackUpdate same = update;
  Make().NameObjectPoints(update);
  EXPECT_EQ(update.runs[0].id, 13u);
  EXPECT_EQ(update.runs[1].id, 3u);
  EXPECT_THAT(update.objects[0].samples[0].left, ElementsAre(10u));
  Make(/*with_object=*/false).NameObjectPoints(same);
  EXPECT_EQ(same.runs[0].id, ObjectPointId(1, 3));
}

}  // namespace
}  // namespace holdfast
