// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/flow.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <utility>

#include "server/engine/motion/patch_coding.h"

namespace holdfast {
namespace {

constexpr int kWindow = 21;  // side of the patch compared, pixels
constexpr int kLevels = 3;   // of the pyramid beyond the picture itself
constexpr int kSteps = 20;   // of the iteration, at each level
constexpr double kStepEnds = 0.01;
constexpr double kSizeOfProcessing = 1.5;  // of the picture, each way, at most; chosen on annotated real video
constexpr int kMostSide = 2;               // times the larger processing side

using Points = std::vector<cv::Point2f>;

cv::Size Window() { return {kWindow, kWindow}; }

cv::TermCriteria Criteria() { return {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, kSteps, kStepEnds}; }

Points ToPoints(absl::Span<const FlowPoint> points) {
  Points result;
  result.reserve(points.size());
  for (const FlowPoint& point : points) result.emplace_back(point.x, point.y);
  return result;
}

// From 'from' to 'to', both pictures or both pyramids, and back again.
struct RoundTrip {
  Points to;
  Points back;
  std::vector<uint8_t> found;  // both ways
  std::vector<float> difference;
};

// 'starts': where to begin to look in 'to'; empty: at the points themselves.
RoundTrip GoAndReturn(cv::InputArray from, cv::InputArray to, const Points& points, const Points& starts, int levels) {
  RoundTrip trip;
  trip.to = starts;
  std::vector<uint8_t> found_back;
  std::vector<float> ignored;
  const int flags = starts.empty() ? 0 : cv::OPTFLOW_USE_INITIAL_FLOW;
  cv::calcOpticalFlowPyrLK(from, to, points, trip.to, trip.found, trip.difference, Window(), levels, Criteria(), flags);
  if (!starts.empty()) trip.back = points;
  cv::calcOpticalFlowPyrLK(to, from, trip.to, trip.back, found_back, ignored, Window(), levels, Criteria(), flags);
  for (size_t i = 0; i < points.size(); ++i) trip.found[i] = trip.found[i] && found_back[i];
  return trip;
}

float Distance(const cv::Point2f& a, const cv::Point2f& b) { return std::hypot(a.x - b.x, a.y - b.y); }

// Of point i, whose search began at 'start'.
std::optional<FlowMatch> MatchOf(const RoundTrip& trip, size_t i, const cv::Point2f& point, const cv::Point2f& start) {
  if (!trip.found[i]) return std::nullopt;
  const FlowMatch match{
      {trip.to[i].x, trip.to[i].y}, Distance(trip.back[i], point), Distance(trip.to[i], start), trip.difference[i]};
  const bool finite = std::isfinite(match.round_trip) && std::isfinite(match.move) && std::isfinite(match.difference);
  return finite ? std::optional(match) : std::nullopt;
}

// The first pixel of a patch with the point in its middle. The point is moved into the picture first.
cv::Point CornerAround(FlowPoint point, ImageSize size) {
  const auto middle = [](float at, int length) {
    return static_cast<int>(std::floor(std::clamp(at, 0.0f, static_cast<float>(length - 1))));
  };
  constexpr int kBefore = FlowPatch::kSide / 2 - 1;
  return {middle(point.x, size.width) - kBefore, middle(point.y, size.height) - kBefore};
}

// The patch of the picture whose first pixel is at 'corner'; the picture's edges are repeated beyond them.
cv::Mat Crop(const cv::Mat& picture, cv::Point corner) {
  const cv::Rect wanted(corner, cv::Size(FlowPatch::kSide, FlowPatch::kSide));
  const cv::Rect there = wanted & cv::Rect(0, 0, picture.cols, picture.rows);
  const cv::Point before = there.tl() - wanted.tl(), after = wanted.br() - there.br();
  cv::Mat crop;
  cv::copyMakeBorder(picture(there), crop, before.y, after.y, before.x, after.x,
                     cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  return crop;
}

double Area(ImageSize size) { return static_cast<double>(size.width) * size.height; }

}  // namespace

ImageSize FlowSize(ImageSize frame, ImageSize processing) {
  const double most_side = kMostSide * std::max(processing.width, processing.height);
  const double of_processing = std::sqrt(Area(processing) / Area(frame));
  const double scale = std::min({std::max(1.0, of_processing), kSizeOfProcessing * of_processing,
                                 most_side / std::max(frame.width, frame.height)});
  constexpr double kRounding = 1e-6;
  const auto scaled = [scale](int side) { return std::max(1, static_cast<int>(side * scale + kRounding)); };
  return {scaled(frame.width), scaled(frame.height)};
}

struct FlowPyramid::Levels {
  std::vector<cv::Mat> images;  // with a border of a window around each
};

FlowPyramid::FlowPyramid(const GrayImage& image)
    : size_(image.size), levels_([&image] {
        const cv::Mat gray(image.size.height, image.size.width, CV_8UC1, const_cast<uint8_t*>(image.pixels.data()));
        auto levels = std::make_unique<Levels>();
        cv::buildOpticalFlowPyramid(gray, levels->images, Window(), kLevels, /*withDerivatives=*/false,
                                    cv::BORDER_REFLECT_101, cv::BORDER_CONSTANT, /*tryReuseInputImage=*/false);
        return levels;
      }()) {}

FlowPyramid::~FlowPyramid() = default;

GrayImage FlowPyramid::picture() const {
  GrayImage copy{size_, std::vector<uint8_t>(static_cast<size_t>(size_.width) * static_cast<size_t>(size_.height))};
  levels_->images[0].copyTo(cv::Mat(size_.height, size_.width, CV_8UC1, copy.pixels.data()));
  return copy;
}

GrayView FlowPyramid::half() const {
  if (levels_->images.size() < 2) return {};
  const cv::Mat& image = levels_->images[1];
  return {{image.cols, image.rows}, image.data, static_cast<int>(image.step)};
}

int64_t FlowPyramid::BytesOf(ImageSize size) {
  int64_t bytes = 0;
  for (int level = 0; level <= kLevels; ++level) {
    bytes += int64_t{size.width + 2 * kWindow} * (size.height + 2 * kWindow);
    size = {(size.width + 1) / 2, (size.height + 1) / 2};
  }
  return bytes;
}

int64_t FlowPyramid::MostBytes(ImageSize processing) {
  // Of pictures of one area the longest has the most border.
  const int longest = kMostSide * std::max(processing.width, processing.height);
  const double area = kSizeOfProcessing * kSizeOfProcessing * Area(processing);
  return BytesOf({longest, static_cast<int>(std::ceil(area / longest)) + 1});
}

std::vector<FlowStep> CarryPoints(const FlowPyramid& from, const FlowPyramid& to, absl::Span<const FlowPoint> points,
                                  float max_round_trip) {
  std::vector<FlowStep> steps;
  if (points.empty()) return steps;
  const Points here = ToPoints(points);
  const RoundTrip trip = GoAndReturn(from.levels().images, to.levels().images, here, {}, kLevels);
  steps.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const bool held = trip.found[i] && Distance(trip.back[i], here[i]) <= max_round_trip;  // false for NaN
    steps.push_back({held ? FlowPoint{trip.to[i].x, trip.to[i].y} : points[i], held});
  }
  return steps;
}

std::vector<std::optional<FlowMatch>> FollowPoints(const FlowPyramid& from, const FlowPyramid& to,
                                                   absl::Span<const FlowPoint> points,
                                                   absl::Span<const FlowPoint> starts) {
  std::vector<std::optional<FlowMatch>> found(points.size());
  if (points.empty()) return found;
  const Points here = ToPoints(points), near = ToPoints(starts);
  const RoundTrip trip = GoAndReturn(from.levels().images, to.levels().images, here, near, kLevels);
  for (size_t i = 0; i < points.size(); ++i) found[i] = MatchOf(trip, i, here[i], near[i]);
  return found;
}

FlowPatch CutPatch(const FlowPyramid& picture, FlowPoint at) {
  FlowPoint halved{at.x / 2, at.y / 2};
  cv::Mat crop = cv::Mat::zeros(FlowPatch::kSide, FlowPatch::kSide, CV_8UC1);
  if (const GrayView half = picture.half(); half.pixels != nullptr) {
    const cv::Point corner = CornerAround(halved, half.size);
    crop = Crop(picture.levels().images[1], corner);
    halved = {halved.x - static_cast<float>(corner.x), halved.y - static_cast<float>(corner.y)};
  }
  std::optional<FlowPatch> patch = ReadPatch(halved, EncodePatch({crop.data, crop.total()}));
  CV_Assert(patch.has_value());
  return *std::move(patch);
}

std::optional<FlowPatch> ReadPatch(FlowPoint at, std::string code) {
  std::optional<std::vector<uint8_t>> pixels = DecodePatch(code);
  if (!pixels) return std::nullopt;
  return FlowPatch{at, std::move(code), *std::move(pixels)};
}

}  // namespace holdfast
