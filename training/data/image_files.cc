// SPDX-License-Identifier: Apache-2.0
#include "training/data/image_files.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

absl::StatusOr<cv::Mat> ReadImage(const std::string& path, int flags) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return absl::NotFoundError(absl::StrCat("no file ", path));
  try {
    cv::Mat image = cv::imread(path, flags);
    if (!image.empty()) return image;
  } catch (const cv::Exception&) {
    // As below: a picture the codec refuses.
  }
  return absl::DataLossError(absl::StrCat("cannot read the picture ", path));
}

absl::Status WriteImage(const std::string& path, const cv::Mat& image, int jpeg_quality) {
  try {
    if (cv::imwrite(path, image, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality})) return absl::OkStatus();
  } catch (const cv::Exception&) {
    // As below.
  }
  return absl::UnavailableError(absl::StrCat("cannot write ", path));
}

absl::Status SizeDiffers(const std::string& path) {
  return absl::DataLossError(absl::StrCat(path, " differs in size from the pictures before it"));
}

// Median of the labels (not 0) in the 7 x 7 pixels about (x, y); 0 without any.
int32_t LabelAround(const cv::Mat& mask, int x, int y) {
  constexpr int kReach = 3;
  constexpr size_t kSide = 2 * kReach + 1;
  std::array<int32_t, kSide * kSide> labels;
  size_t count = 0;
  for (int j = std::max(y - kReach, 0); j <= std::min(y + kReach, mask.rows - 1); ++j) {
    for (int i = std::max(x - kReach, 0); i <= std::min(x + kReach, mask.cols - 1); ++i) {
      const int32_t label = mask.at<int32_t>(j, i);
      if (label != 0) labels[count++] = label;
    }
  }
  if (count == 0) return 0;
  std::nth_element(labels.begin(), labels.begin() + static_cast<int64_t>(count / 2),
                   labels.begin() + static_cast<int64_t>(count));
  return labels[count / 2];
}

// One ring of the hole: its pixels near labels take the median of those.
bool FillRing(std::vector<cv::Point>& hole, cv::Mat& mask) {
  std::vector<std::pair<cv::Point, int32_t>> filled;
  std::vector<cv::Point> rest;
  for (const cv::Point at : hole) {
    const int32_t label = LabelAround(mask, at.x, at.y);
    if (label == 0) {
      rest.push_back(at);
    } else {
      filled.emplace_back(at, label);
    }
  }
  for (const auto& [at, label] : filled) mask.at<int32_t>(at) = label;
  hole = std::move(rest);
  return !filled.empty();
}

}  // namespace

absl::StatusOr<cv::Mat> ReadFrame(const std::string& path) {
  absl::StatusOr<cv::Mat> image = ReadImage(path, cv::IMREAD_COLOR);
  if (image.ok()) cv::cvtColor(*image, *image, cv::COLOR_BGR2RGB);
  return image;
}

absl::StatusOr<cv::Mat> ReadMask(const std::string& path) {
  absl::StatusOr<cv::Mat> image = ReadImage(path, cv::IMREAD_UNCHANGED);
  if (!image.ok()) return image;
  if (image->depth() != CV_8U && image->depth() != CV_16U) {
    return absl::DataLossError(absl::StrCat(path, " is not a mask of 8 or 16 bits"));
  }
  cv::Mat first, ids;
  cv::extractChannel(*image, first, 0);
  first.convertTo(ids, CV_32S);
  return ids;
}

absl::Status WriteFrame(const std::string& path, const cv::Mat& frame, int jpeg_quality) {
  cv::Mat bgr;
  cv::cvtColor(frame, bgr, cv::COLOR_RGB2BGR);
  return WriteImage(path, bgr, jpeg_quality);
}

absl::Status WriteMask(const std::string& path, const cv::Mat& mask) {
  cv::Mat ids;
  mask.convertTo(ids, CV_16U);
  return WriteImage(path, ids, 0);
}

absl::Status ReadFrames(const std::vector<std::string>& paths, ImageSize size, Sample& sample) {
  sample.frames.clear();
  cv::Size first;
  for (const std::string& path : paths) {
    absl::StatusOr<cv::Mat> frame = ReadFrame(path);
    if (!frame.ok()) return frame.status();
    if (sample.frames.empty()) first = frame->size();
    if (frame->size() != first) return SizeDiffers(path);
    if (!size.empty()) {
      const bool shrinks = size.width < first.width;
      cv::resize(*frame, *frame, {size.width, size.height}, 0, 0, shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
    }
    sample.frames.push_back(*std::move(frame));
  }
  return absl::OkStatus();
}

absl::Status ReadMasks(const std::vector<std::string>& paths, Sample& sample) {
  sample.masks.clear();
  for (const std::string& path : paths) {
    absl::StatusOr<cv::Mat> mask = ReadMask(path);
    if (!mask.ok()) return mask.status();
    if (!sample.frames.empty() && mask->size() != sample.frames[0].size()) return SizeDiffers(path);
    sample.masks.push_back(*std::move(mask));
  }
  return absl::OkStatus();
}

void FillHoles(int min_pixels, cv::Mat& mask) {
  constexpr int kRounds = 16;  // of three pixels each: deeper insides stay unlabelled
  cv::Mat labels, statistics, centres;
  const int count = cv::connectedComponentsWithStats(mask == 0, labels, statistics, centres, 8, CV_32S);
  std::vector<cv::Point> hole;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int label = labels.at<int32_t>(y, x);
      if (label > 0 && label < count && statistics.at<int32_t>(label, cv::CC_STAT_AREA) > min_pixels)
        hole.emplace_back(x, y);
    }
  }
  for (int round = 0; round < kRounds && !hole.empty(); ++round) {
    if (!FillRing(hole, mask)) return;
  }
}

void ScaleTracks(ImageSize from, Sample& sample) {
  const double sx = static_cast<double>(sample.size().width) / from.width;
  const double sy = static_cast<double>(sample.size().height) / from.height;
  for (size_t i = 0; i + 1 < sample.tracks.size(); i += 2) {
    sample.tracks[i] = static_cast<float>(sample.tracks[i] * sx);
    sample.tracks[i + 1] = static_cast<float>(sample.tracks[i + 1] * sy);
  }
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      if (!sample.Inside(sample.Position(s, n))) sample.visible[sample.At(s, n)] = 0;
    }
  }
}

}  // namespace holdfast
