// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/inverse_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

const cv::Point2d kCentre(100, 80);
const cv::Rect kArea(37, 21, 90, 70);

// How far from a pixel the forward map has what the pixel shows, in pixels of the image.
struct Error {
  double mean = 0, worst = 0;
};

Error ErrorOf(const PlaneMap& map) {
  cv::Mat x, y;
  InverseMaps(map, kCentre, kArea, x, y);
  EXPECT_GE(x.cols, kArea.width);
  EXPECT_GE(x.rows, kArea.height);
  Error error;
  for (int row = 0; row < kArea.height; ++row) {
    for (int column = 0; column < kArea.width; ++column) {
      const cv::Point2d texture(x.at<float>(row, column), y.at<float>(row, column));
      const cv::Point2d shown = map.ImageFromPlane(texture - kCentre) - cv::Point2d(kArea.tl());
      const double off = std::hypot(shown.x - column, shown.y - row);
      error.mean += off / kArea.area();
      error.worst = std::max(error.worst, off);
    }
  }
  return error;
}

// A plane of the given scale, turned and tilted a little.
cv::Matx33d View(double scale, double angle) {
  const double c = scale * std::cos(angle), s = scale * std::sin(angle);
  return {c, -s, 80, s, c, 60, 2e-4, -1e-4, 1};
}

TEST(InverseMapTest, AFlatPlaneIsExact) {
  EXPECT_LT(ErrorOf(PlaneMap(View(0.7, 0.3), ElasticWaves(), 0)).worst, 0.005);
}

TEST(InverseMapTest, ABentPlaneIsShownWhereItsPointsAreHoweverSmall) {
  Rng rng(4);
  for (const double scale : {2.0, 1.0, 0.6, 0.4, 0.25, 0.15}) {
    double mean = 0, worst = 0;
    constexpr int kMaps = 10;
    for (int i = 0; i < kMaps; ++i) {
      const cv::Matx33d view = View(scale, rng.Uniform(0, 6));
      const PlaneMap map(view, ElasticWaves::Random(rng, 0.45, 60), 2);
      const Error error = ErrorOf(map);
      mean += error.mean / kMaps;
      worst = std::max(worst, error.worst);
    }
    EXPECT_LT(mean, 0.01) << scale;
    EXPECT_LT(worst, 0.07) << scale;
  }
}

}  // namespace
}  // namespace holdfast
