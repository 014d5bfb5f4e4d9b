// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/object_shape.h"

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "api/limits.h"

namespace holdfast {
namespace {

std::vector<Pixel> Outline(const std::vector<cv::Point>& ends) {
  std::vector<cv::Point> hull;
  cv::convexHull(ends, hull);
  // What is left of the corners of something convex is convex.
  for (double epsilon = 0.5; hull.size() > kMaxOutlineCorners; epsilon *= 1.5) {
    std::vector<cv::Point> fewer;
    cv::approxPolyDP(hull, fewer, epsilon, /*closed=*/true);
    hull = fewer;
  }
  std::vector<Pixel> outline;
  outline.reserve(hull.size());
  for (const cv::Point& corner : hull) outline.push_back({static_cast<float>(corner.x), static_cast<float>(corner.y)});
  return outline;
}

}  // namespace

ObjectShape ShapeOf(const GrayImage& mask) {
  double count = 0, sum_x = 0, sum_y = 0;
  std::vector<cv::Point> ends;  // the first and the last pixel of each row
  for (int y = 0; y < mask.size.height; ++y) {
    const uint8_t* row = mask.pixels.data() + int64_t{y} * mask.size.width;
    int first = -1, last = -1;
    int64_t in_row = 0, row_x = 0;
    for (int x = 0; x < mask.size.width; ++x) {
      if (row[x] == 0) continue;
      if (first < 0) first = x;
      last = x;
      ++in_row;
      row_x += x;
    }
    if (first < 0) continue;
    ends.emplace_back(first, y);
    ends.emplace_back(last, y);
    count += static_cast<double>(in_row);
    sum_x += static_cast<double>(row_x);
    sum_y += static_cast<double>(in_row) * y;
  }
  ObjectShape shape;
  shape.centre = {static_cast<float>(sum_x / count), static_cast<float>(sum_y / count)};
  shape.size = static_cast<float>(std::sqrt(count));
  shape.outline = Outline(ends);
  return shape;
}

}  // namespace holdfast
