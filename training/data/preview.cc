// SPDX-License-Identifier: Apache-2.0
#include "training/data/preview.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "absl/strings/str_cat.h"
#include "training/data/image_files.h"
#include "training/data/rng.h"

namespace holdfast {
namespace {

constexpr int kShift = 3;  // bits after the point in the drawing functions' coordinates
constexpr int64_t kTailFrames = 5;

cv::Scalar ColourOf(uint64_t number) {
  const uint64_t bits = MixSeed(1, number);
  return {static_cast<double>(64 + bits % 192), static_cast<double>(64 + (bits >> 8) % 192),
          static_cast<double>(64 + (bits >> 16) % 192)};
}

cv::Point Fixed(cv::Point2f xy) {
  return {static_cast<int>(xy.x * (1 << kShift)), static_cast<int>(xy.y * (1 << kShift))};
}

cv::Mat MaskColours(const cv::Mat& mask) {
  cv::Mat colours(mask.size(), CV_8UC3, cv::Scalar());
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int32_t id = mask.at<int32_t>(y, x);
      if (id == 0) continue;
      const cv::Scalar colour = ColourOf(static_cast<uint64_t>(id));
      colours.at<cv::Vec3b>(y, x) =
          cv::Vec3b(static_cast<uint8_t>(colour[0]), static_cast<uint8_t>(colour[1]), static_cast<uint8_t>(colour[2]));
    }
  }
  return colours;
}

}  // namespace

cv::Mat DrawPoints(const Sample& sample, int64_t frame) {
  cv::Mat picture = sample.frames[static_cast<size_t>(frame)].clone();
  for (int64_t n = 0; n < sample.num_points(); ++n) {
    const cv::Scalar colour = ColourOf(static_cast<uint64_t>(n));
    for (int64_t s = std::max<int64_t>(1, frame - kTailFrames); s <= frame; ++s) {
      if (!sample.Valid(s, n) || !sample.Valid(s - 1, n)) continue;
      cv::line(picture, Fixed(sample.Position(s - 1, n)), Fixed(sample.Position(s, n)), colour, 1, cv::LINE_AA, kShift);
    }
    if (!sample.Valid(frame, n)) continue;
    const int thickness = sample.Visible(frame, n) ? static_cast<int>(cv::FILLED) : 1;
    cv::circle(picture, Fixed(sample.Position(frame, n)), 3 << kShift, colour, thickness, cv::LINE_AA, kShift);
  }
  return picture;
}

absl::Status WritePreviewVideo(const Sample& sample, const std::string& path) {
  const double fps = sample.fps > 0 ? sample.fps : 8;
  cv::VideoWriter video(path, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), fps,
                        cv::Size(sample.size().width, sample.size().height));
  if (!video.isOpened()) return absl::UnavailableError(absl::StrCat("cannot write ", path));
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    cv::Mat bgr;
    cv::cvtColor(DrawPoints(sample, s), bgr, cv::COLOR_RGB2BGR);
    video.write(bgr);
  }
  return absl::OkStatus();
}

absl::Status WriteContactSheet(const Sample& sample, int columns, const std::string& path) {
  std::vector<cv::Mat> frames, masks;
  for (int i = 0; i < columns; ++i) {
    const int64_t s = columns > 1 ? i * (sample.num_frames() - 1) / (columns - 1) : 0;
    frames.push_back(DrawPoints(sample, s));
    if (sample.has_masks()) masks.push_back(MaskColours(sample.masks[static_cast<size_t>(s)]));
  }
  cv::Mat sheet, below;
  cv::hconcat(frames, sheet);
  if (!masks.empty()) {
    cv::hconcat(masks, below);
    cv::vconcat(sheet, below, sheet);
  }
  return WriteFrame(path, sheet);
}

}  // namespace holdfast
