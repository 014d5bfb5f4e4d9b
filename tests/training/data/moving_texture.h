// SPDX-License-Identifier: Apache-2.0
// Clips of a textured plane that slides by a whole number of pixels a frame, so that every track is known exactly.
#pragma once

#include <cmath>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "training/data/dataset.h"
#include "training/data/sample.h"

namespace holdfast {

// A colour that differs from place to place, smoothly.
inline cv::Vec3b TextureAt(int x, int y) {
  const double a =
      std::sin(x * 0.31) + std::sin(y * 0.23) + std::sin((x + 2 * y) * 0.11) + std::sin((3 * x - y) * 0.07);
  return {cv::saturate_cast<uchar>(128 + 30 * a), cv::saturate_cast<uchar>(128 + 25 * a),
          cv::saturate_cast<uchar>(128 - 28 * a)};
}

// 'starts' are followed from frame 0, visible while inside the frame.
inline Sample MovingTexture(int64_t frames, ImageSize size, cv::Point2f step, const std::vector<cv::Point2f>& starts) {
  Sample sample;
  sample.source = "moving texture";
  for (int64_t t = 0; t < frames; ++t) {
    cv::Mat image(size.height, size.width, CV_8UC3);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        image.at<cv::Vec3b>(y, x) = TextureAt(x - static_cast<int>(step.x) * t, y - static_cast<int>(step.y) * t);
      }
    }
    sample.frames.push_back(image);
  }
  sample.AllocatePoints(static_cast<int64_t>(starts.size()));
  for (int64_t t = 0; t < frames; ++t) {
    for (size_t n = 0; n < starts.size(); ++n) {
      const cv::Point2f xy = starts[n] + step * static_cast<float>(t);
      sample.SetPosition(t, n, xy);
      sample.valid[sample.At(t, n)] = 1;
      sample.visible[sample.At(t, n)] = sample.Inside(xy);
    }
  }
  return sample;
}

// 6 frames of 64 x 48 that slide right by 2; masks: 1 left, 2 right of column 30. The last of the 4 points leaves.
inline Sample TwoObjectClip() {
  Sample clip = MovingTexture(6, {64, 48}, {2, 0}, {{10, 10}, {20, 30}, {40, 20}, {60, 40}});
  for (int64_t s = 0; s < 6; ++s) {
    cv::Mat mask(48, 64, CV_32SC1, cv::Scalar(1));
    mask.colRange(30, 64).setTo(2);
    clip.masks.push_back(mask);
  }
  return clip;
}

// A data set of samples, or of the errors that stand in their place.
class ListDataset final : public Dataset {
 public:
  explicit ListDataset(std::vector<absl::StatusOr<Sample>> samples) : samples_(std::move(samples)) {}
  size_t size() const override { return samples_.size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng&) const override { return samples_[index]; }

 private:
  const std::vector<absl::StatusOr<Sample>> samples_;
};

}  // namespace holdfast
