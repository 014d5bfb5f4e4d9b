// SPDX-License-Identifier: Apache-2.0
#include "training/data/augment.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_cat.h"
#include "training/data/curve.h"
#include "training/data/photometric.h"

namespace holdfast {
namespace {

constexpr uint64_t kGrainSeed = 11;
constexpr int kMaxPad = 64;  // black pixels a random crop may have at a side

// Gives every position to 'move' and hides points that are outside after it.
template <typename Move>
void MovePoints(Sample& sample, Move move) {
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      const cv::Point2f xy = move(s, sample.Position(s, n));
      sample.SetPosition(s, n, xy);
      if (!sample.Inside(xy)) sample.visible[sample.At(s, n)] = 0;
    }
  }
}

void FlipImages(int axis, Sample& sample) {
  for (cv::Mat& frame : sample.frames) cv::flip(frame, frame, axis);
  for (cv::Mat& mask : sample.masks) cv::flip(mask, mask, axis);
}

// Reverses the order of the rows (of 'width' values each).
template <typename T>
void ReverseRows(std::vector<T>& values, int64_t width) {
  if (values.empty()) return;
  std::vector<T> reversed;
  reversed.reserve(values.size());
  for (auto end = values.end(); end != values.begin(); end -= width) reversed.insert(reversed.end(), end - width, end);
  values = std::move(reversed);
}

// The window of 'size' at 'corner' of an image; 0 where that leaves it.
cv::Mat Window(const cv::Mat& image, cv::Point corner, cv::Size size) {
  cv::Mat window = cv::Mat::zeros(size, image.type());
  const cv::Rect wanted(corner, size), there = wanted & cv::Rect({0, 0}, image.size());
  if (!there.empty()) image(there).copyTo(window(there - corner));
  return window;
}

cv::Mat Scaled(const cv::Mat& frame, cv::Size size) {
  cv::Mat scaled;
  cv::resize(frame, scaled, size, 0, 0, size.area() < frame.size().area() ? cv::INTER_AREA : cv::INTER_LINEAR);
  return scaled;
}

// Where a window of 'length' may begin in 'all' pixels: anywhere inside, a little outside if it is the larger one.
int RandomCorner(int all, int length, Rng& rng) {
  return static_cast<int>(rng.Integer(std::min(0, all - length), std::max(0, all - length)));
}

// Mean place of the points seen in the first frame; the frame's centre if there are none.
cv::Point2d CentreOfInterest(const Sample& sample) {
  cv::Point2d sum;
  int64_t count = 0;
  for (int64_t n = 0; n < sample.num_points(); ++n) {
    if (!sample.Visible(0, n)) continue;
    sum += cv::Point2d(sample.Position(0, n));
    ++count;
  }
  if (count == 0) return {sample.size().width / 2.0, sample.size().height / 2.0};
  return sum / static_cast<double>(count);
}

void EraseRectangle(cv::Rect area, Sample& sample, int64_t s, const cv::Scalar& colour) {
  cv::Mat& frame = sample.frames[static_cast<size_t>(s)];
  area &= cv::Rect({0, 0}, frame.size());
  if (area.empty()) return;
  frame(area).setTo(colour);
  if (sample.has_masks()) sample.masks[static_cast<size_t>(s)](area).setTo(0);
  for (int64_t n = 0; n < sample.num_points(); ++n) {
    const cv::Point2f xy = sample.Position(s, n);
    const bool beneath = xy.x > static_cast<float>(area.x) - 1 && xy.y > static_cast<float>(area.y) - 1 &&
                         xy.x < static_cast<float>(area.br().x) && xy.y < static_cast<float>(area.br().y);
    if (beneath) sample.visible[sample.At(s, n)] = 0;
  }
}

}  // namespace

void ReverseTime(Sample& sample) {
  std::reverse(sample.frames.begin(), sample.frames.end());
  std::reverse(sample.masks.begin(), sample.masks.end());
  ReverseRows(sample.tracks, 2 * sample.num_points());
  ReverseRows(sample.visible, sample.num_points());
  ReverseRows(sample.valid, sample.num_points());
}

void FlipHorizontally(Sample& sample) {
  FlipImages(1, sample);
  const float last = static_cast<float>(sample.size().width - 1);
  MovePoints(sample, [last](int64_t, cv::Point2f xy) { return cv::Point2f(last - xy.x, xy.y); });
}

void FlipVertically(Sample& sample) {
  FlipImages(0, sample);
  const float last = static_cast<float>(sample.size().height - 1);
  MovePoints(sample, [last](int64_t, cv::Point2f xy) { return cv::Point2f(xy.x, last - xy.y); });
}

void Transpose(Sample& sample) {
  for (cv::Mat& frame : sample.frames) frame = frame.t();
  for (cv::Mat& mask : sample.masks) mask = mask.t();
  MovePoints(sample, [](int64_t, cv::Point2f xy) { return cv::Point2f(xy.y, xy.x); });
}

void ScaleAndCrop(const std::vector<cv::Size>& scaled, const std::vector<cv::Point>& corner, cv::Size size,
                  Sample& sample) {
  const ImageSize old = sample.size();
  for (size_t s = 0; s < sample.frames.size(); ++s) {
    sample.frames[s] = Window(Scaled(sample.frames[s], scaled[s]), corner[s], size);
    if (!sample.has_masks()) continue;
    cv::Mat mask;
    // By pixel centres, as the pictures; INTER_NEAREST takes corners for them.
    cv::resize(sample.masks[s], mask, scaled[s], 0, 0, cv::INTER_NEAREST_EXACT);
    sample.masks[s] = Window(mask, corner[s], size);
  }
  MovePoints(sample, [&](int64_t s, cv::Point2f xy) {
    const size_t i = static_cast<size_t>(s);
    // Pixel centres, as cv::resize has them: scales differ from frame to frame, so half a pixel would be a motion.
    const double x = (xy.x + 0.5) * scaled[i].width / old.width - 0.5 - corner[i].x;
    const double y = (xy.y + 0.5) * scaled[i].height / old.height - 0.5 - corner[i].y;
    return cv::Point2f(static_cast<float>(x), static_cast<float>(y));
  });
}

void CropOrScale(ImageSize size, Rng& rng, Sample& sample) {
  const size_t frames = sample.frames.size();
  const cv::Size window(size.width, size.height);
  if (rng.Chance(0.5))
    return ScaleAndCrop(std::vector(frames, window), std::vector(frames, cv::Point()), window, sample);
  const cv::Size native(sample.size().width, sample.size().height);
  const int y = RandomCorner(native.height, window.height, rng), x = RandomCorner(native.width, window.width, rng);
  ScaleAndCrop(std::vector(frames, native), std::vector(frames, cv::Point(x, y)), window, sample);
}

void DriftingCrop(const AugmentOptions& options, Rng& rng, Sample& sample) {
  const double duration = static_cast<double>(sample.num_frames() - 1);
  const cv::Size window(options.size.width, options.size.height);
  const cv::Size native(sample.size().width, sample.size().height);
  const double base = std::exp(rng.Uniform(std::log(options.min_scale), std::log(options.max_scale)));
  const Curve stretch_x = Curve::Wander(rng, 0.15, duration), stretch_y = Curve::Wander(rng, 0.15, duration);
  const Curve zoom = Curve::Wander(rng, 0.3, duration);
  const Curve shift_x = Curve::Wander(rng, 60, duration), shift_y = Curve::Wander(rng, 60, duration);
  const cv::Point2d focus = CentreOfInterest(sample);
  const double pad_y = rng.Uniform(-kMaxPad, kMaxPad), pad_x = rng.Uniform(-kMaxPad, kMaxPad);
  std::vector<cv::Size> scaled;
  std::vector<cv::Point> corner;
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    const double t = static_cast<double>(s), scale = base * std::exp(zoom.At(t));
    // Never much smaller than the window: what is asked for is content, not black.
    const double least = std::max((window.width - kMaxPad) / static_cast<double>(native.width),
                                  (window.height - kMaxPad) / static_cast<double>(native.height));
    const double sx = std::max(scale * std::exp(stretch_x.At(t)), least);
    const double sy = std::max(scale * std::exp(stretch_y.At(t)), least);
    scaled.emplace_back(static_cast<int>(native.width * sx), static_cast<int>(native.height * sy));
    corner.emplace_back(static_cast<int>(focus.x * sx - window.width / 2.0 + pad_x + shift_x.At(t)),
                        static_cast<int>(focus.y * sy - window.height / 2.0 + pad_y + shift_y.At(t)));
    corner.back().x =
        std::clamp(corner.back().x, -kMaxPad, std::max(-kMaxPad, scaled.back().width - window.width + kMaxPad));
    corner.back().y =
        std::clamp(corner.back().y, -kMaxPad, std::max(-kMaxPad, scaled.back().height - window.height + kMaxPad));
  }
  ScaleAndCrop(scaled, corner, window, sample);
}

void EraseRectangles(Rng& rng, Sample& sample) {
  const double duration = static_cast<double>(sample.num_frames() - 1);
  const double width = sample.size().width, height = sample.size().height;
  const int64_t count = rng.Integer(1, 3);
  for (int64_t i = 0; i < count; ++i) {
    const int64_t from = rng.Integer(1, std::max<int64_t>(1, sample.num_frames() - 1));
    const int64_t length = rng.Integer(1, std::max<int64_t>(1, sample.num_frames() / 2));
    const double centre_y = rng.Uniform(0, height), centre_x = rng.Uniform(0, width);
    const double half_y = rng.Uniform(0.03, 0.25) * height, half_x = rng.Uniform(0.03, 0.25) * width;
    const Curve x = Curve::Wander(rng, 0.3 * width, duration), y = Curve::Wander(rng, 0.3 * height, duration);
    const Curve grow = Curve::Wander(rng, 0.5, duration);
    for (int64_t s = from; s < std::min(from + length, sample.num_frames()); ++s) {
      const double t = static_cast<double>(s), size = std::exp(grow.At(t));
      const cv::Point low(static_cast<int>(centre_x + x.At(t) - half_x * size),
                          static_cast<int>(centre_y + y.At(t) - half_y * size));
      const cv::Size box(static_cast<int>(2 * half_x * size) + 1, static_cast<int>(2 * half_y * size) + 1);
      const cv::Rect area = cv::Rect(low, box) & cv::Rect(0, 0, sample.size().width, sample.size().height);
      if (area.empty()) continue;
      EraseRectangle(area, sample, s, cv::mean(sample.frames[static_cast<size_t>(s)](area)));
    }
  }
}

absl::Status AugmentOptions::Validate() const {
  if (size.width < 8 || size.height < 8 || size.width > 8192 || size.height > 8192) {
    return absl::InvalidArgumentError("the size of augmented clips must be 8 to 8192 pixels a side");
  }
  if (!(min_scale > 0 && min_scale <= max_scale && max_scale <= 8)) {
    return absl::InvalidArgumentError("scales must be in (0, 8], the lower one first");
  }
  for (const double share :
       {photometric_share, eraser_share, drift_share, flip_share, reverse_share, transpose_share}) {
    if (!(share >= 0 && share <= 1))
      return absl::InvalidArgumentError(absl::StrCat("a share of ", share, " is not in [0, 1]"));
  }
  return absl::OkStatus();
}

Augmenter::Augmenter(const AugmentOptions& options)
    : options_(options), grain_(MakeGrain({options.size.width, options.size.height}, kGrainSeed)) {}

void Augmenter::Apply(Rng& rng, Sample& sample) const {
  // The source may share its pictures with others; every step below writes to new ones or to these copies.
  if (rng.Chance(options_.reverse_share)) ReverseTime(sample);
  if (rng.Chance(options_.transpose_share)) Transpose(sample);
  if (rng.Chance(options_.drift_share)) {
    DriftingCrop(options_, rng, sample);
  } else {
    CropOrScale(options_.size, rng, sample);
  }
  if (rng.Chance(options_.flip_share)) FlipHorizontally(sample);
  if (rng.Chance(options_.flip_share)) FlipVertically(sample);
  if (rng.Chance(options_.eraser_share)) EraseRectangles(rng, sample);
  if (!rng.Chance(options_.photometric_share)) return;
  const Photometric look = Photometric::Random(rng, static_cast<double>(sample.num_frames() - 1), grain_);
  for (size_t s = 0; s < sample.frames.size(); ++s) look.Apply(static_cast<double>(s), rng, sample.frames[s]);
}

}  // namespace holdfast
