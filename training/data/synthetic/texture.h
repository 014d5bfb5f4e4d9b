// SPDX-License-Identifier: Apache-2.0
// Procedural pictures, so that synthetic scenes need no files: noise octaves, stripes, cells, gradients, scattered
// shapes.
#pragma once

#include <opencv2/core.hpp>

#include "training/data/rng.h"

namespace holdfast {

// [size] CV_8UC3 RGB
cv::Mat ProceduralTexture(cv::Size size, Rng& rng);

// Soft-edged random outline that fills most of 'size' (blob, polygon, ellipse, bar or ring) with a margin of at least
// two transparent pixels: [size] CV_8UC1, 0 outside, 255 inside.
cv::Mat CutOutMask(cv::Size size, Rng& rng);

// An outline for layers as large as the frame: hills, branches or islands of noise that fill about 'cover' of 'size',
// with edges about two pixels soft. [size] CV_8UC1
cv::Mat CoverMask(cv::Size size, double cover, Rng& rng);

// A bar along x with round ends and a margin of two transparent pixels. [size] CV_8UC1. REQUIRES: wider than high.
cv::Mat LimbMask(cv::Size size);

// 'picture' ([h, w] CV_8UC3) made hard to follow: faint, blurred, or a small part of it over and over.
cv::Mat Plain(const cv::Mat& picture, Rng& rng);

}  // namespace holdfast
