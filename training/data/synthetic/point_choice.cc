// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/point_choice.h"

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>

namespace holdfast {
namespace {

// Pixels of each id that have it all around; all its pixels where none has.
std::map<int32_t, std::vector<cv::Point>> PixelsById(const cv::Mat& ids) {
  std::map<int32_t, std::vector<cv::Point>> inner, all;
  for (int y = 0; y < ids.rows; ++y) {
    const int32_t* row = ids.ptr<int32_t>(y);
    const int32_t* above = ids.ptr<int32_t>(std::max(y - 2, 0));
    const int32_t* below = ids.ptr<int32_t>(std::min(y + 2, ids.rows - 1));
    for (int x = 0; x < ids.cols; ++x) {
      const int left = std::max(x - 2, 0), right = std::min(x + 2, ids.cols - 1);
      const int32_t id = row[x];
      const bool same = row[left] == id && row[right] == id && above[x] == id && below[x] == id && above[left] == id &&
                        above[right] == id && below[left] == id && below[right] == id;
      (same ? inner : all)[id].emplace_back(x, y);
    }
  }
  for (auto& [id, pixels] : all) {
    if (inner.count(id) == 0) inner[id] = std::move(pixels);
  }
  return inner;
}

// Spread of the green channel about a pixel.
int Contrast(const cv::Mat& frame, cv::Point at) {
  constexpr int kReach = 2;
  int low = 255, high = 0;
  for (int y = std::max(at.y - kReach, 0); y <= std::min(at.y + kReach, frame.rows - 1); ++y) {
    for (int x = std::max(at.x - kReach, 0); x <= std::min(at.x + kReach, frame.cols - 1); ++x) {
      const int value = frame.at<cv::Vec3b>(y, x)[1];
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  return high - low;
}

cv::Point Pick(const std::vector<cv::Point>& pixels, const cv::Mat& frame, Rng& rng) {
  const cv::Point a = pixels[static_cast<size_t>(rng.Below(static_cast<int64_t>(pixels.size())))];
  const cv::Point b = pixels[static_cast<size_t>(rng.Below(static_cast<int64_t>(pixels.size())))];
  return Contrast(frame, a) >= Contrast(frame, b) ? a : b;
}

// A place that rounds to the pixel and stays in the frame on its way to the plane of its layer and back.
cv::Point2d Within(cv::Point pixel, cv::Size size, Rng& rng) {
  constexpr double kMargin = 0.02;  // pixels
  return {std::clamp(pixel.x + rng.Uniform(-0.48, 0.48), kMargin, size.width - 1 - kMargin),
          std::clamp(pixel.y + rng.Uniform(-0.48, 0.48), kMargin, size.height - 1 - kMargin)};
}

}  // namespace

std::vector<cv::Point2d> ChoosePoints(const cv::Mat& frame, const cv::Mat& ids, int32_t background, int64_t count,
                                      Rng& rng) {
  const std::map<int32_t, std::vector<cv::Point>> pixels = PixelsById(ids);
  std::vector<const std::vector<cv::Point>*> objects;
  std::vector<cv::Point> anywhere;
  for (const auto& [id, places] : pixels) {
    if (id > background) objects.push_back(&places);
    anywhere.insert(anywhere.end(), places.begin(), places.end());
  }
  std::vector<cv::Point2d> points;
  for (int64_t n = 0; n < count; ++n) {
    const bool on_object = n % 2 == 0 && !objects.empty();
    const std::vector<cv::Point>& from =
        on_object ? *objects[static_cast<size_t>(rng.Below(static_cast<int64_t>(objects.size())))] : anywhere;
    points.push_back(Within(Pick(from, frame, rng), frame.size(), rng));
  }
  return points;
}

}  // namespace holdfast
