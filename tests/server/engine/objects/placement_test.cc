// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/placement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace holdfast {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr ImageSize kSize{160, 120};

GrayImage Of(const cv::Mat& picture) {
  return {{picture.cols, picture.rows}, {picture.begin<uint8_t>(), picture.end<uint8_t>()}};
}

// Noise right of the middle, nothing left of it.
GrayImage HalfTextured() {
  cv::Mat picture(kSize.height, kSize.width, CV_8UC1, cv::Scalar(128));
  cv::RNG random(3);
  cv::Mat right = picture.colRange(kSize.width / 2, kSize.width);
  random.fill(right, cv::RNG::UNIFORM, 0, 256);
  return Of(picture);
}

GrayImage Mask(const cv::Rect& where) {
  cv::Mat mask(kSize.height, kSize.width, CV_8UC1, cv::Scalar(0));
  mask(where).setTo(255);
  return Of(mask);
}

double LeastDistance(const std::vector<FlowPoint>& places) {
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < places.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      least = std::min<double>(least, std::hypot(places[i].x - places[j].x, places[i].y - places[j].y));
    }
  }
  return least;
}

TEST(PlacePointsTest, PlacesLieInsideAndFarApart) {
  const cv::Rect where(90, 20, 60, 80);
  const std::vector<FlowPoint> places = PlacePoints(HalfTextured(), Mask(where), 20);
  ASSERT_THAT(places, SizeIs(20));
  for (const FlowPoint& place : places) {
    EXPECT_TRUE(where.contains(cv::Point(static_cast<int>(place.x), static_cast<int>(place.y))));
  }
  // A square lattice would have sqrt(60 * 80 / 20) = 15.5 pixels between its places.
  EXPECT_GT(LeastDistance(places), 7);
}

TEST(PlacePointsTest, PrefersTextureButCoversPlainPartsToo) {
  const std::vector<FlowPoint> places = PlacePoints(HalfTextured(), Mask({10, 10, 140, 100}), 30);
  const auto textured =
      std::count_if(places.begin(), places.end(), [](const FlowPoint& place) { return place.x >= 78; });
  EXPECT_GT(textured, 17);
  EXPECT_LT(textured, 30);
}

TEST(PlacePointsTest, ASmallObjectGetsFewerPoints) {
  EXPECT_THAT(PlacePoints(HalfTextured(), Mask({0, 0, 1, 1}), 64), SizeIs(1));
  EXPECT_THAT(PlacePoints(HalfTextured(), Mask({40, 40, 2, 2}), 64), SizeIs(4));
  EXPECT_THAT(PlacePoints(HalfTextured(), Mask({0, 0, 0, 0}), 64), IsEmpty());
}

TEST(PlacePointsTest, APictureWithoutTextureIsCoveredEvenly) {
  const cv::Mat plain(kSize.height, kSize.width, CV_8UC1, cv::Scalar(7));
  EXPECT_GT(LeastDistance(PlacePoints(Of(plain), Mask({0, 0, 160, 120}), 12)), 25);
}

}  // namespace
}  // namespace holdfast
