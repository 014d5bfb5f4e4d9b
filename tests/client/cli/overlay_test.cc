// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "tests/client/cli/moving_points.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

int Brightest(const cv::Mat& picture) {
  double largest = 0;
  cv::minMaxLoc(picture.clone().reshape(1), nullptr, &largest);
  return static_cast<int>(largest);
}

TEST(OverlayPainterTest, AVisiblePointIsADiscAndAHiddenOneARing) {
  cv::Mat disc = Black(), ring = Black();
  OverlayPainter(0).Paint(MovingPoints(1, 1, 1, true), 0, disc);
  OverlayPainter(0).Paint(MovingPoints(1, 1, 1, false), 0, ring);
  EXPECT_GT(Brightness(disc, 30, 20), 200);
  EXPECT_LT(Brightness(ring, 30, 20), 60);
  EXPECT_GT(Brightest(ring.row(20)), 150);
  EXPECT_EQ(Brightness(disc, 40, 20), 0) << "no trail was asked for";
}

TEST(OverlayPainterTest, ATrailFadesWithAgeAndEnds) {
  cv::Mat picture = Black();
  OverlayPainter(20).Paint(MovingPoints(1, 28, 28, true), 26, picture);  // the point is at x = 290
  EXPECT_GT(Brightness(picture, 275, 20), 200);
  EXPECT_GT(Brightness(picture, 275, 20), Brightness(picture, 175, 20));
  EXPECT_GT(Brightness(picture, 175, 20), Brightness(picture, 105, 20));
  EXPECT_GT(Brightness(picture, 105, 20), 0);
  EXPECT_EQ(Brightness(picture, 60, 20), 0);
}

TEST(OverlayPainterTest, NeighboursHaveDifferentColoursThatStay) {
  const TrackTable table = MovingPoints(2, 2, 2, true);
  cv::Mat first = Black(), second = Black();
  OverlayPainter(0).Paint(table, 0, first);
  OverlayPainter(0).Paint(table, 1, second);
  EXPECT_NE(first.at<cv::Vec3b>(20, 30), first.at<cv::Vec3b>(60, 30));
  EXPECT_EQ(first.at<cv::Vec3b>(20, 30), second.at<cv::Vec3b>(20, 40));
}

TEST(OverlayPainterTest, PositionsFarOutsideAndNotANumberAreNotDrawn) {
  TrackTable table({{{1, 0, 0}, 0, ""}, {{2, 0, 0}, 0, ""}});
  const float nan = std::numeric_limits<float>::quiet_NaN();
  ASSERT_THAT(
      table.Apply(
          {{{1, 0, {nan, 1e30f}, {5, 5}, {1, 1}, {1, 1}, 2}, {2, 0, {-9, -9}, {5, 5}, {1, 1}, {1, 1}, 2}}, 2, 2}),
      IsOk());
  cv::Mat picture = Black();
  OverlayPainter(20).Paint(table, 1, picture);
  EXPECT_EQ(cv::countNonZero(picture.reshape(1)), 0);
}

TEST(OverlayPainterTest, AnObjectsOutlineIsDrawnAndThePointsThatHaveLeftItAreCrossedOut) {
  StartObject object;
  object.query.id = 1;
  TrackTable table({}, object);
  TrackUpdate update{{{1, 0, {30}, {20}, {0}, {1}, 1}, {2, 0, {60}, {20}, {0}, {1}, 1}}, 1, 1};
  update.objects = {{1, 0, {{{45, 20}, 1, 0, 1, {{10, 10}, {90, 10}, {90, 60}, {10, 60}}, {2}}}, 1}};
  ASSERT_THAT(table.Apply(update), IsOk());
  cv::Mat picture = Black();
  OverlayPainter(0).Paint(table, 0, picture);
  EXPECT_GT(Brightness(picture, 50, 10), 200);
  EXPECT_GT(Brightness(picture, 90, 30), 200);
  EXPECT_EQ(Brightness(picture, 50, 40), 0);
  const cv::Vec3b stays = picture.at<cv::Vec3b>(20, 30), left = picture.at<cv::Vec3b>(20, 60);
  EXPECT_LT(stays[2], 60) << "the inside of a ring";
  EXPECT_GT(left[2], 200) << "red";
}

}  // namespace
}  // namespace holdfast
