// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/object_shape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "api/limits.h"

namespace holdfast {
namespace {

GrayImage Empty(ImageSize size) { return {size, std::vector<uint8_t>(Pixels(size), 0)}; }

cv::Mat View(GrayImage& image) { return cv::Mat(image.size.height, image.size.width, CV_8UC1, image.pixels.data()); }

GrayImage Rectangle(ImageSize size, const cv::Rect& where) {
  GrayImage mask = Empty(size);
  cv::rectangle(View(mask), where, cv::Scalar(1), cv::FILLED);
  return mask;
}

TEST(ShapeOfTest, ARectangleHasFourCornersAndItsMiddle) {
  const ObjectShape shape = ShapeOf(Rectangle({100, 80}, {20, 30, 40, 10}));
  EXPECT_FLOAT_EQ(shape.centre.x, 39.5f);
  EXPECT_FLOAT_EQ(shape.centre.y, 34.5f);
  EXPECT_FLOAT_EQ(shape.size, 20);
  ASSERT_EQ(shape.outline.size(), 4u);
  for (const Pixel& corner : shape.outline) {
    EXPECT_TRUE(corner.x == 20 || corner.x == 59) << corner.x;
    EXPECT_TRUE(corner.y == 30 || corner.y == 39) << corner.y;
  }
}

TEST(ShapeOfTest, AnOutlineIsConvexAndHasFewCorners) {
  GrayImage mask = Empty({600, 600});
  cv::circle(View(mask), {300, 300}, 280, cv::Scalar(255), cv::FILLED);
  const ObjectShape shape = ShapeOf(mask);
  EXPECT_LE(shape.outline.size(), static_cast<size_t>(kMaxOutlineCorners));
  std::vector<cv::Point2f> corners;
  for (const Pixel& corner : shape.outline) corners.emplace_back(corner.x, corner.y);
  EXPECT_TRUE(cv::isContourConvex(corners));
  EXPECT_GT(cv::contourArea(corners), 0.97 * 3.14159 * 280 * 280);
}

TEST(ShapeOfTest, OnePixelIsAnObjectToo) {
  const ObjectShape shape = ShapeOf(Rectangle({8, 8}, {7, 0, 1, 1}));
  EXPECT_FLOAT_EQ(shape.centre.x, 7);
  EXPECT_EQ(shape.outline.size(), 1u);
}

}  // namespace
}  // namespace holdfast
