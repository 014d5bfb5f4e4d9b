// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_source.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

constexpr int kDefaultMaskPoints = 64;
constexpr size_t kMaxCandidates = 20000;  // pixels looked at for a mask's points; bounds the time

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

struct Candidate {
  cv::Point2f at;
  float room;  // how far it is from the border and from the points chosen so far
};

// Every nonzero pixel, or an even choice of them. The picture's edge counts as the object's border.
std::vector<Candidate> Candidates(const cv::Mat& mask) {
  cv::Mat framed, depth;
  cv::copyMakeBorder(mask, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, cv::Scalar(0));
  cv::distanceTransform(framed, depth, cv::DIST_L2, cv::DIST_MASK_5);
  std::vector<cv::Point> pixels;
  cv::findNonZero(mask, pixels);
  const size_t step = pixels.size() / kMaxCandidates + 1;
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < pixels.size(); i += step) {
    // Twice the depth: between two points as well as beside the border there is then as much room.
    candidates.push_back({cv::Point2f(pixels[i]), 2 * depth.at<float>(pixels[i] + cv::Point(1, 1))});
  }
  return candidates;
}

absl::StatusOr<std::vector<cv::Point2f>> GeneratedPoints(const PointOptions& options, ImageSize size) {
  if (options.mask.empty()) return GridPoints(options.grid, size);
  const absl::StatusOr<cv::Mat> mask = ReadMask(options.mask, size);
  if (!mask.ok()) return mask.status();
  return MaskPoints(options.grid == 0 ? kDefaultMaskPoints : options.grid, *mask);
}

}  // namespace

absl::Status PointOptions::Validate() const {
  if (file.empty() && mask.empty() && grid == 0) {
    return absl::InvalidArgumentError("no points to track: give --grid=100, --points=FILE or --mask=FILE");
  }
  if (grid < 0 || grid > 100000) return absl::InvalidArgumentError("--grid: expected 1..100000");
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
  if (options.grid == 0 && options.mask.empty()) return points;
  const auto generated = GeneratedPoints(options, size);
  if (!generated.ok()) return generated.status();
  const int64_t frame = options.query_frame < 0 ? first_frame : options.query_frame;
  PointId last_id = 0;
  for (const StartPoint& point : points) last_id = std::max(last_id, point.query.id);
  for (const cv::Point2f& at : *generated) {
    ++last_id;
    points.push_back({{last_id, at.x, at.y}, frame, absl::StrCat(last_id)});
  }
  return points;
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

std::vector<cv::Point2f> MaskPoints(int count, const cv::Mat& mask) {
  std::vector<Candidate> candidates = Candidates(mask);
  const auto less_room = [](const Candidate& a, const Candidate& b) { return a.room < b.room; };
  std::vector<cv::Point2f> points;
  while (static_cast<int>(points.size()) < count && !candidates.empty()) {
    const Candidate best = *std::max_element(candidates.begin(), candidates.end(), less_room);
    if (best.room <= 0) break;  // every pixel is taken
    points.push_back(best.at);
    for (Candidate& candidate : candidates) {
      const cv::Point2f apart = candidate.at - best.at;
      candidate.room = std::min(candidate.room, std::hypot(apart.x, apart.y));
    }
  }
  return points;
}

}  // namespace holdfast
