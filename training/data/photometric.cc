// SPDX-License-Identifier: Apache-2.0
#include "training/data/photometric.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace holdfast {
namespace {

constexpr int kGrainSpare = 64;         // pixels the grain is larger than a frame, to cut from different places
constexpr double kGrainDeviation = 32;  // grey levels

}  // namespace

cv::Mat MakeGrain(cv::Size frame, uint64_t seed) {
  Rng rng(seed);
  cv::Mat grain(frame.height + kGrainSpare, frame.width + kGrainSpare, CV_8UC3);
  for (int y = 0; y < grain.rows; ++y) {
    uint8_t* row = grain.ptr<uint8_t>(y);
    for (int i = 0; i < 3 * grain.cols; ++i) row[i] = cv::saturate_cast<uint8_t>(128 + kGrainDeviation * rng.Normal());
  }
  return grain;
}

Photometric Photometric::Random(Rng& rng, double duration, const cv::Mat& grain) {
  Photometric look(grain);
  look.drifts_ = rng.Chance(0.6);
  look.gamma_ = std::exp(rng.Uniform(-0.35, 0.35));
  const Curve exposure = Curve::Wander(rng, 0.25, duration);
  for (size_t c = 0; c < 3; ++c) {
    look.gain_[c] =
        Curve({exposure.At(0) + rng.Uniform(-0.12, 0.12), exposure.At(duration / 2) + rng.Uniform(-0.12, 0.12),
               exposure.At(duration) + rng.Uniform(-0.12, 0.12)},
              duration);
    look.offset_[c] = Curve::Wander(rng, 20, duration);
  }
  if (rng.Chance(0.2)) look.flicker_ = Curve::Random(rng, 1 + static_cast<int>(duration), 0.15, duration);
  if (rng.Chance(0.15)) look.lamp_ = rng.Uniform(0.2, 0.6);
  look.lamp_x_ = Curve::Random(rng, 3, 0.5, duration);
  look.lamp_y_ = Curve::Random(rng, 3, 0.5, duration);
  if (rng.Chance(0.1)) look.reduction_ = rng.Uniform(0.4, 0.8);
  if (rng.Chance(0.25)) look.blur_px_ = rng.Uniform(0.4, 1.2);
  if (rng.Chance(0.5)) look.noise_ = rng.Uniform(1, 8) / kGrainDeviation;
  if (rng.Chance(0.5)) look.jpeg_quality_ = static_cast<int>(rng.Integer(20, 95));
  return look;
}

// [1, 256] CV_8UC3
cv::Mat Photometric::ColourTable(double time) const {
  cv::Mat table(1, 256, CV_8UC3);
  for (int c = 0; c < 3; ++c) {
    const double gain = 1 + gain_[static_cast<size_t>(c)].At(time) + flicker_.At(time),
                 offset = offset_[static_cast<size_t>(c)].At(time);
    for (int i = 0; i < 256; ++i) {
      const double value = 255 * gain * std::pow(i / 255.0, gamma_) + offset;
      table.at<cv::Vec3b>(0, i)[c] = cv::saturate_cast<uint8_t>(value);
    }
  }
  return table;
}

// Darkens the frame away from a lamp that moves over it, as an endoscope's does.
void Photometric::Shade(double time, cv::Mat& frame) const {
  const float x = static_cast<float>((0.5 + lamp_x_.At(time)) * frame.cols);
  const float y = static_cast<float>((0.5 + lamp_y_.At(time)) * frame.rows);
  const float reach = static_cast<float>(frame.cols * frame.cols + frame.rows * frame.rows) / 4;  // squared
  const float strength = static_cast<float>(lamp_);
  for (int row = 0; row < frame.rows; ++row) {
    uint8_t* pixel = frame.ptr<uint8_t>(row);
    const float dy = static_cast<float>(row) - y;
    for (int column = 0; column < frame.cols; ++column, pixel += 3) {
      const float dx = static_cast<float>(column) - x;
      const float keep = 1 - strength * std::min(1.f, (dx * dx + dy * dy) / reach);
      for (int c = 0; c < 3; ++c) pixel[c] = static_cast<uint8_t>(static_cast<float>(pixel[c]) * keep);
    }
  }
}

void Photometric::Apply(double time, Rng& rng, cv::Mat& frame) const {
  if (drifts_) cv::LUT(frame, ColourTable(time), frame);
  if (lamp_ > 0) Shade(time, frame);
  if (reduction_ < 1) {
    cv::Mat small;
    const cv::Size full = frame.size();
    // By sizes, not by factors, so that the way back is the same and nothing shifts against the labels.
    const cv::Size reduced(cvRound(full.width * reduction_), cvRound(full.height * reduction_));
    cv::resize(frame, small, reduced, 0, 0, cv::INTER_AREA);
    cv::resize(small, frame, full, 0, 0, cv::INTER_LINEAR);
  }
  if (blur_px_ > 0) cv::GaussianBlur(frame, frame, {5, 5}, blur_px_);
  if (noise_ > 0) {
    const int y = static_cast<int>(rng.Below(kGrainSpare)), x = static_cast<int>(rng.Below(kGrainSpare));
    cv::addWeighted(frame, 1, grain_(cv::Rect({x, y}, frame.size())), noise_, -128 * noise_, frame);
  }
  if (jpeg_quality_ > 0) {
    // The codec takes RGB for BGR on both ways; the loss is of the same kind.
    std::vector<uint8_t> bytes;
    cv::imencode(".jpg", frame, bytes, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality_});
    cv::imdecode(bytes, cv::IMREAD_COLOR, &frame);
  }
}

}  // namespace holdfast
