// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/object_input.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::SizeIs;

// A frame and the picture that flow sees of it.
constexpr ImageSize kFrame{1920, 1080}, kFlow{886, 498};

cv::Mat MaskOf(const cv::Rect& where, ImageSize size = kFrame) {
  cv::Mat mask(size.height, size.width, CV_8UC1, cv::Scalar(0));
  mask(where).setTo(255);
  return mask;
}

absl::StatusOr<PlacedObject> PlaceOn(const cv::Mat& mask, ImageSize gray_size = kFlow, int points = 0) {
  ObjectQuery object;
  object.points = points;
  std::vector<uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(".png", mask, bytes));
  object.mask_png.assign(bytes.begin(), bytes.end());
  GrayImage gray{gray_size, {}};
  for (int64_t i = 0; i < Pixels(gray_size); ++i) gray.pixels.push_back(static_cast<uint8_t>(i * i % 251));
  return PlaceObject(object, "object", {mask.cols, mask.rows}, gray);
}

void ExpectAllOnMask(const cv::Mat& mask, const std::vector<PointQuery>& points) {
  std::set<std::pair<float, float>> places;
  for (const PointQuery& point : points) {
    EXPECT_NE(mask.at<uint8_t>(cvRound(point.y), cvRound(point.x)), 0) << point.x << ", " << point.y;
    EXPECT_TRUE(places.emplace(point.x, point.y).second) << "two points at " << point.x << ", " << point.y;
  }
}

TEST(PlaceObjectTest, AThinMaskHasRoomWhereverItLies) {
  for (int offset = 0; offset < 12; ++offset) {
    for (const int width : {1, 2, 3}) {
      SCOPED_TRACE(testing::Message() << width << " wide, at " << offset);
      for (const cv::Mat& mask : {MaskOf({700 + offset, 100, width, 800}), MaskOf({100, 700 + offset, 800, width})}) {
        const auto placed = PlaceOn(mask);
        ASSERT_THAT(placed, IsOk());
        EXPECT_THAT(placed->points, SizeIs(64));
        ExpectAllOnMask(mask, placed->points);
      }
    }
  }
}

TEST(PlaceObjectTest, ThinMasksAtTheFramesBordersHaveRoom) {
  for (const cv::Rect& where :
       {cv::Rect(0, 0, 1, 1080), cv::Rect(1919, 0, 1, 1080), cv::Rect(0, 0, 1920, 1), cv::Rect(0, 1079, 1920, 1)}) {
    const cv::Mat mask = MaskOf(where);
    const auto placed = PlaceOn(mask);
    ASSERT_THAT(placed, IsOk());
    EXPECT_THAT(placed->points, SizeIs(64));
    ExpectAllOnMask(mask, placed->points);
  }
}

TEST(PlaceObjectTest, PointsLieOnAMaskOfAnyForm) {
  cv::Mat mask = MaskOf({0, 0, 0, 0});
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) mask.at<uint8_t>(y, x) = (x * 7 + y * 3) % 11 == 0 ? 255 : 0;
  }
  const auto placed = PlaceOn(mask, kFlow, 256);
  ASSERT_THAT(placed, IsOk());
  EXPECT_THAT(placed->points, SizeIs(256));
  ExpectAllOnMask(mask, placed->points);
}

// Of frames that have fewer pixels than are processed flow sees more pixels than there are.
TEST(PlaceObjectTest, APictureMayBeLargerThanItsFrame) {
  const cv::Mat mask = MaskOf({10, 20, 2, 30}, {96, 72});
  const auto placed = PlaceOn(mask, {512, 384}, 16);
  ASSERT_THAT(placed, IsOk());
  EXPECT_THAT(placed->points, SizeIs(16));
  for (const PointQuery& point : placed->points) {
    EXPECT_NE(mask.at<uint8_t>(static_cast<int>(point.y), static_cast<int>(point.x)), 0);
  }
}

}  // namespace
}  // namespace holdfast
