// SPDX-License-Identifier: Apache-2.0
// What a camera does to colours: exposure and white balance that drift, flicker, uneven light, softness, sensor
// noise, compression.
#pragma once

#include <opencv2/core.hpp>

#include <array>

#include "training/data/curve.h"
#include "training/data/rng.h"

namespace holdfast {

// Noise to cut from, for frames of up to 'frame' pixels: CV_8UC3 about 128.
cv::Mat MakeGrain(cv::Size frame, uint64_t seed);

// The treatment of one clip. Each of its parts is on in some clips only.
class Photometric {
 public:
  // 'grain' (MakeGrain) is borrowed.
  static Photometric Random(Rng& rng, double duration, const cv::Mat& grain);

  // frame: [H, W] CV_8UC3 RGB, changed in place. 'rng' places the noise.
  void Apply(double time, Rng& rng, cv::Mat& frame) const;

 private:
  explicit Photometric(const cv::Mat& grain) : grain_(grain) {}
  cv::Mat ColourTable(double time) const;
  void Shade(double time, cv::Mat& frame) const;

  const cv::Mat& grain_;
  bool drifts_ = false;
  double gamma_ = 1;
  std::array<Curve, 3> gain_;    // of R, G, B, added to 1
  std::array<Curve, 3> offset_;  // grey levels
  Curve flicker_;                // added to all gains, anew in each frame
  double lamp_ = 0;              // what a lamp that moves leaves dark, [0, 1]; 0: even light
  Curve lamp_x_, lamp_y_;        // of the frame, from its centre
  double reduction_ = 1;         // a small video blown up: what it was of the frame's size
  double blur_px_ = 0;           // deviation
  double noise_ = 0;             // weight of the grain
  int jpeg_quality_ = 0;         // 0: none
};

}  // namespace holdfast
