// SPDX-License-Identifier: Apache-2.0
// Procedural pictures, so that synthetic scenes need no files: noise octaves, stripes, cells, gradients, scattered
// shapes.
#pragma once

#include <opencv2/core.hpp>

#include "training/rng.h"

namespace holdfast {

// [size] CV_8UC3 RGB
cv::Mat ProceduralTexture(cv::Size size, Rng& rng);

// Soft-edged random outline that fills most of 'size' (blob, polygon, ellipse, bar or ring) with a margin of at least
// two transparent pixels: [size] CV_8UC1, 0 outside, 255 inside.
cv::Mat CutOutMask(cv::Size size, Rng& rng);

}  // namespace holdfast
