// SPDX-License-Identifier: Apache-2.0
// Random changes of recorded clips that keep their labels true.
#pragma once

#include <opencv2/core.hpp>

#include "absl/status/status.h"
#include "training/data/rng.h"
#include "training/data/sample.h"

namespace holdfast {

struct AugmentOptions {
  ImageSize size = {512, 384};               // of the result, pixels
  double photometric_share = 0.8;            // colours, blur, noise, compression; each probability is per clip
  double eraser_share = 0.3;                 // rectangles that come, move, change and go: what lies beneath is occluded
  double drift_share = 0.7;                  // scale and crop drift over time; else cut or scaled once
  double min_scale = 0.25, max_scale = 1.5;  // of the drifting crop
  double flip_share = 0.5;                   // for either axis
  double reverse_share = 0.5;                // time runs backwards
  double transpose_share = 0.2;              // x and y change places

  absl::Status Validate() const;
};

// Exact changes; masks, tracks and visibility follow.
void ReverseTime(Sample& sample);
void FlipHorizontally(Sample& sample);
void FlipVertically(Sample& sample);
void Transpose(Sample& sample);
// Frame s is scaled to scaled[s] pixels, and the window of 'size' whose corner is corner[s] is cut from it; black, and
// unlabelled in the masks, where that leaves the picture. Points outside are not visible.
void ScaleAndCrop(const std::vector<cv::Size>& scaled, const std::vector<cv::Point>& corner, cv::Size size,
                  Sample& sample);

// Random ones. All expect masks to be there or not as in Sample.
void CropOrScale(ImageSize size, Rng& rng, Sample& sample);
void DriftingCrop(const AugmentOptions& options, Rng& rng, Sample& sample);
void EraseRectangles(Rng& rng, Sample& sample);

// Thread-safe.
class Augmenter {
 public:
  // REQUIRES: options are valid.
  explicit Augmenter(const AugmentOptions& options);
  void Apply(Rng& rng, Sample& sample) const;

 private:
  const AugmentOptions options_;
  const cv::Mat grain_;  // sensor noise
};

}  // namespace holdfast
