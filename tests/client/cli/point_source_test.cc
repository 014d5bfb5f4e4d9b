// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// A ring: evenly spread points must go round it and none may fall into its hole.
cv::Mat RingMask(int side) {
  cv::Mat mask = cv::Mat::zeros(side, side, CV_8U);
  cv::circle(mask, {side / 2, side / 2}, side * 2 / 5, cv::Scalar(255), cv::FILLED);
  cv::circle(mask, {side / 2, side / 2}, side / 5, cv::Scalar(0), cv::FILLED);
  return mask;
}

float SmallestDistance(const std::vector<cv::Point2f>& points) {
  float smallest = 1e9f;
  for (size_t i = 0; i < points.size(); ++i) {
    for (size_t j = 0; j < i; ++j) smallest = std::min(smallest, static_cast<float>(cv::norm(points[i] - points[j])));
  }
  return smallest;
}

TEST(GridPointsTest, CellsAreNearlySquareAndTheirCentresTileTheFrame) {
  const auto points = GridPoints(12, {40, 30});
  ASSERT_EQ(points.size(), 12u);  // 4 x 3 cells of 10 x 10
  EXPECT_EQ(points[0], cv::Point2f(4.5f, 4.5f));
  EXPECT_EQ(points[1], cv::Point2f(14.5f, 4.5f));
  EXPECT_EQ(points[11], cv::Point2f(34.5f, 24.5f));
}

TEST(GridPointsTest, AnyCountOnAnyShapeIsNearlyMetAndStaysInside) {
  for (const ImageSize size : {ImageSize{768, 576}, ImageSize{2000, 20}, ImageSize{3, 900}, ImageSize{1, 1}}) {
    for (int count : {1, 2, 7, 100, 1000}) {
      const auto points = GridPoints(count, size);
      ASSERT_FALSE(points.empty());
      EXPECT_LE(points.size(), static_cast<size_t>(count) * 3 / 2 + 1);
      for (const auto& p : points) {
        EXPECT_TRUE(p.x >= 0 && p.y >= 0 && p.x <= size.width - 1 && p.y <= size.height - 1) << p;
      }
    }
  }
  EXPECT_NEAR(static_cast<double>(GridPoints(100, {768, 576}).size()), 100, 10);
}

TEST(MaskPointsTest, PointsLieOnTheObjectFarFromEachOtherAndOffItsBorder) {
  const cv::Mat mask = RingMask(200);
  const auto points = MaskPoints(24, mask);
  ASSERT_EQ(points.size(), 24u);
  for (const auto& p : points) EXPECT_NE(mask.at<uint8_t>(cv::Point(p)), 0);
  EXPECT_GT(SmallestDistance(points), 15);
  cv::Mat inner;
  cv::erode(mask, inner, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
  for (const auto& p : points) EXPECT_NE(inner.at<uint8_t>(cv::Point(p)), 0) << p;
}

TEST(MaskPointsTest, TheSameMaskGivesTheSamePoints) {
  EXPECT_EQ(MaskPoints(9, RingMask(90)), MaskPoints(9, RingMask(90)));
}

TEST(MaskPointsTest, ASmallObjectGivesNoMorePointsThanPixels) {
  cv::Mat mask = cv::Mat::zeros(8, 8, CV_8U);
  mask.at<uint8_t>(0, 0) = mask.at<uint8_t>(7, 7) = mask.at<uint8_t>(7, 6) = 1;
  EXPECT_EQ(MaskPoints(10, mask).size(), 3u);
}

TEST(MaskPointsTest, ALargeMaskIsSampledOnAllOfItsParts) {
  const auto points = MaskPoints(16, cv::Mat(1200, 1600, CV_8U, cv::Scalar(1)));
  ASSERT_EQ(points.size(), 16u);
  EXPECT_GT(SmallestDistance(points), 200);
}

class CollectPointsTest : public ::testing::Test {
 protected:
  std::string Mask(int width, int height, int value) {
    cv::imwrite(dir_.File("mask.png"), cv::Mat(height, width, CV_8U, cv::Scalar(value)));
    return dir_.File("mask.png");
  }
  TempDir dir_;
};

TEST_F(CollectPointsTest, NoSourceAtAllIsAnErrorThatNamesTheFlags) {
  EXPECT_THAT(PointOptions{}.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--grid")));
  PointOptions options;
  options.grid = -4;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--grid")));
  options.grid = 4;
  EXPECT_THAT(options.Validate(), IsOk());
}

TEST_F(CollectPointsTest, GridPointsGetTheIdsAfterThoseOfTheFile) {
  std::ofstream(dir_.File("p.csv")) << "41,1,2,5\n7,3,4\n";
  PointOptions options;
  options.file = dir_.File("p.csv");
  options.grid = 4;
  options.query_frame = 2;
  const auto points = CollectPoints(options, {20, 20});
  ASSERT_THAT(points, IsOk());
  ASSERT_EQ(points->size(), 6u);
  EXPECT_EQ((*points)[0].query.id, 41u);
  EXPECT_EQ((*points)[0].frame, 5);
  EXPECT_EQ((*points)[2].query.id, 42u);
  EXPECT_EQ((*points)[5].query.id, 45u);
  EXPECT_EQ((*points)[5].frame, 2);
}

TEST_F(CollectPointsTest, AMaskGivesAsManyPointsAsTheGridSays) {
  PointOptions options;
  options.mask = Mask(40, 30, 1);
  EXPECT_EQ(CollectPoints(options, {40, 30})->size(), 64u);
  options.grid = 5;
  EXPECT_EQ(CollectPoints(options, {40, 30})->size(), 5u);
}

TEST_F(CollectPointsTest, WrongMasksAreErrors) {
  PointOptions options;
  options.mask = Mask(40, 30, 0);
  EXPECT_THAT(CollectPoints(options, {40, 30}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("all zero")));
  options.mask = Mask(40, 31, 1);
  EXPECT_THAT(CollectPoints(options, {40, 30}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("40x31")));
  std::ofstream(dir_.File("mask.png")) << "no picture";
  EXPECT_THAT(CollectPoints(options, {40, 30}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("mask.png")));
}

}  // namespace
}  // namespace holdfast
