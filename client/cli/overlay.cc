// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace holdfast {
namespace {

constexpr int kSubpixelBits = 4;
constexpr int kTrailBands = 5;  // steps in which a trail fades
constexpr double kGoldenRatio = 0.6180339887498949;
constexpr float kUnitsPerSide = 180;  // a disc's radius is two of so many units of the picture's shorter side
constexpr float kFarOutside = 16384;  // pixels; keeps the fixed-point coordinates in their range

cv::Scalar ColorOf(size_t index) {
  // Steps of the golden ratio keep neighbours apart, however many there are.
  const double hue = std::fmod(0.08 + static_cast<double>(index) * kGoldenRatio, 1.0);
  cv::Mat3b pixel(1, 1, cv::Vec3b(cv::saturate_cast<uint8_t>(hue * 180), 205, 255));
  cv::cvtColor(pixel, pixel, cv::COLOR_HSV2BGR);
  const cv::Vec3b bgr = pixel(0, 0);
  return {static_cast<double>(bgr[0]), static_cast<double>(bgr[1]), static_cast<double>(bgr[2])};
}

bool Drawable(const TrackSample* sample) {
  return sample != nullptr && std::abs(sample->x) < kFarOutside && std::abs(sample->y) < kFarOutside;
}

cv::Point Fixed(const TrackSample& sample) {
  constexpr float kScale = 1 << kSubpixelBits;
  return {static_cast<int>(std::lround(sample.x * kScale)), static_cast<int>(std::lround(sample.y * kScale))};
}

float Unit(const cv::Mat& picture) {
  return std::max(2.0f, static_cast<float>(std::min(picture.cols, picture.rows)) / kUnitsPerSide);
}

int FixedRadius(float radius) { return static_cast<int>(std::lround(radius * (1 << kSubpixelBits))); }

void PaintPoint(const TrackSample& sample, const cv::Scalar& color, cv::Mat& picture) {
  const float unit = Unit(picture);
  const cv::Point center = Fixed(sample);
  const cv::Scalar dark(30, 30, 30);
  if (sample.visible) {
    cv::circle(picture, center, FixedRadius(1.35f * unit), dark, cv::FILLED, cv::LINE_AA, kSubpixelBits);
    cv::circle(picture, center, FixedRadius(1.0f * unit), color, cv::FILLED, cv::LINE_AA, kSubpixelBits);
    return;
  }
  // Dark inside: the point's own trail would fill the ring.
  const int thickness = std::max(1, static_cast<int>(std::lround(0.4f * unit)));
  cv::circle(picture, center, FixedRadius(1.6f * unit), dark, cv::FILLED, cv::LINE_AA, kSubpixelBits);
  cv::circle(picture, center, FixedRadius(1.15f * unit), color, thickness, cv::LINE_AA, kSubpixelBits);
}

void PaintOutline(const ObjectSample& object, cv::Mat& picture) {
  std::vector<cv::Point> corners;
  for (const Pixel& corner : object.outline) {
    TrackSample at;
    at.x = std::clamp(corner.x, -kFarOutside, kFarOutside);
    at.y = std::clamp(corner.y, -kFarOutside, kFarOutside);
    corners.push_back(Fixed(at));
  }
  const int thickness = std::max(1, static_cast<int>(std::lround(0.8f * Unit(picture))));
  const cv::Scalar dark(30, 30, 30), bright(255, 255, 255);
  cv::polylines(picture, corners, true, dark, thickness + 2, cv::LINE_AA, kSubpixelBits);
  cv::polylines(picture, corners, true, bright, thickness, cv::LINE_AA, kSubpixelBits);
}

bool HasLeft(const ObjectSample& object, PointId id) {
  return std::binary_search(object.left.begin(), object.left.end(), id);
}

void CrossOut(const TrackSample& sample, cv::Mat& picture) {
  const int arm = FixedRadius(2 * Unit(picture));
  const int thickness = std::max(1, static_cast<int>(std::lround(0.5f * Unit(picture))));
  const cv::Point at = Fixed(sample);
  for (const cv::Point way : {cv::Point(arm, arm), cv::Point(arm, -arm)}) {
    cv::line(picture, at - way, at + way, cv::Scalar(60, 60, 255), thickness, cv::LINE_AA, kSubpixelBits);
  }
}

}  // namespace

void OverlayPainter::Paint(const TrackTable& table, int64_t frame, cv::Mat& picture) const {
  if (trail_frames_ > 0) PaintTrails(table, frame, picture);
  const ObjectSample* object = table.ObjectEstimate(frame);
  if (object != nullptr) PaintOutline(*object, picture);
  for (size_t i = 0; i < table.tracks().size(); ++i) {
    const TrackSample* sample = TrackTable::Estimate(table.tracks()[i], frame);
    if (!Drawable(sample)) continue;
    PaintPoint(*sample, ColorOf(i), picture);
    if (object != nullptr && HasLeft(*object, table.tracks()[i].start.query.id)) CrossOut(*sample, picture);
  }
}

void OverlayPainter::PaintTrails(const TrackTable& table, int64_t frame, cv::Mat& picture) const {
  const int thickness = std::max(1, static_cast<int>(std::lround(0.6f * Unit(picture))));
  cv::Mat layer;
  for (int band = 0; band < kTrailBands; ++band) {  // the oldest first, and the faintest
    const int64_t from = frame - trail_frames_ + int64_t{trail_frames_} * band / kTrailBands;
    const int64_t to = frame - trail_frames_ + int64_t{trail_frames_} * (band + 1) / kTrailBands;
    picture.copyTo(layer);
    for (size_t i = 0; i < table.tracks().size(); ++i) {
      for (int64_t t = std::max<int64_t>(from, 0); t < to; ++t) {
        const TrackSample* a = TrackTable::Estimate(table.tracks()[i], t);
        const TrackSample* b = TrackTable::Estimate(table.tracks()[i], t + 1);
        if (!Drawable(a) || !Drawable(b)) continue;
        cv::line(layer, Fixed(*a), Fixed(*b), ColorOf(i), thickness, cv::LINE_AA, kSubpixelBits);
      }
    }
    const double strength = static_cast<double>(band + 1) / kTrailBands;
    cv::addWeighted(layer, strength, picture, 1 - strength, 0, picture);
  }
}

}  // namespace holdfast
