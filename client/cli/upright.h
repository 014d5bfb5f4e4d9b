// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace holdfast {

// How stored pictures become those that a viewer shows: rows and columns change places, then the picture is mirrored.
struct Turn {
  bool transpose = false;
  bool flip_x = false;  // left becomes right
  bool flip_y = false;  // top becomes bottom
};

cv::Mat Turned(const cv::Mat& picture, const Turn& turn);

// 'matrix': {a, b, u, c, d, v, x, y, w}, of fixed-point numbers, as MP4 has it: it takes a pixel (x, y) to (a x + c y,
// b x + d y). None that turns by other than right angles is followed.
Turn TurnOf(const int32_t* matrix);

}  // namespace holdfast
