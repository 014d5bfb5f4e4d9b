// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_source.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/limits.h"

namespace holdfast {
namespace {

// [H, W] uint8, 255 where any colour channel is not zero.
absl::StatusOr<cv::Mat> ReadMask(const std::string& path, ImageSize size) {
  cv::Mat picture;
  try {
    picture = cv::imread(path, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
  } catch (const cv::Exception&) {  // a picture too large, for one
  }
  if (picture.empty()) return absl::InvalidArgumentError(absl::StrCat(path, ": is not a picture that can be read"));
  if (picture.cols != size.width || picture.rows != size.height) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the mask is ", picture.cols, "x", picture.rows, ", the frames are ", ToString(size)));
  }
  std::vector<cv::Mat> channels;
  cv::split(picture, channels);
  cv::Mat mask = channels[0] != 0;
  for (const cv::Mat& channel : channels) mask |= channel != 0;
  if (cv::countNonZero(mask) == 0) return absl::InvalidArgumentError(absl::StrCat(path, ": the mask is all zero"));
  return mask;
}

PointId LastId(const std::vector<StartPoint>& points) {
  PointId last = 0;
  for (const StartPoint& point : points) last = std::max(last, point.query.id);
  return last;
}

int64_t StartFrame(const PointOptions& options, int64_t first_frame) {
  return options.query_frame < 0 ? first_frame : options.query_frame;
}

}  // namespace

absl::Status PointOptions::Validate() const {
  if (file.empty() && mask.empty() && grid == 0) {
    return absl::InvalidArgumentError("no points to track: give --grid=100, --points=FILE or --mask=FILE");
  }
  if (grid < 0 || grid > 100000) return absl::InvalidArgumentError("--grid: expected 1..100000");
  if (!mask.empty() && grid > kMaxObjectPoints) {
    return absl::InvalidArgumentError(absl::StrCat("--grid: expected at most ", kMaxObjectPoints, " on a mask"));
  }
  if (query_frame < -1) return absl::InvalidArgumentError("--query_frame: expected -1 or more");
  return absl::OkStatus();
}

absl::StatusOr<std::vector<StartPoint>> CollectPoints(const PointOptions& options, ImageSize size,
                                                      int64_t first_frame) {
  std::vector<StartPoint> points;
  if (!options.file.empty()) {
    auto read = ReadPointFile(options.file, size, first_frame);
    if (!read.ok()) return read.status();
    points = *std::move(read);
  }
  if (options.grid == 0 || !options.mask.empty()) return points;
  const int64_t frame = StartFrame(options, first_frame);
  PointId last_id = LastId(points);
  for (const cv::Point2f& at : GridPoints(options.grid, size)) {
    ++last_id;
    points.push_back({{last_id, at.x, at.y}, frame, absl::StrCat(last_id)});
  }
  return points;
}

absl::StatusOr<std::optional<StartObject>> CollectObject(const PointOptions& options, ImageSize size,
                                                         const std::vector<StartPoint>& points, int64_t first_frame) {
  if (options.mask.empty()) return std::nullopt;
  const absl::StatusOr<cv::Mat> mask = ReadMask(options.mask, size);
  if (!mask.ok()) return mask.status();
  std::vector<uint8_t> png;
  cv::imencode(".png", *mask, png);
  StartObject object;
  object.query.id = 1;
  object.query.mask_png.assign(png.begin(), png.end());
  object.query.points = options.grid;
  object.query.reseed = options.reseed;
  object.frame = StartFrame(options, first_frame);
  object.first_point = LastId(points) + 1;
  return object;
}

std::vector<cv::Point2f> GridPoints(int count, ImageSize size) {
  const double cell = std::sqrt(static_cast<double>(size.width) * size.height / count);
  const int columns = std::clamp(static_cast<int>(std::lround(size.width / cell)), 1, std::min(count, size.width));
  const int rows = std::clamp(static_cast<int>(std::lround(static_cast<double>(count) / columns)), 1, size.height);
  std::vector<cv::Point2f> points;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      points.emplace_back((column + 0.5f) * static_cast<float>(size.width) / static_cast<float>(columns) - 0.5f,
                          (row + 0.5f) * static_cast<float>(size.height) / static_cast<float>(rows) - 0.5f);
    }
  }
  return points;
}

}  // namespace holdfast
