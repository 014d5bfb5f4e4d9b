// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>

namespace holdfast {

// How stored pictures become those that a viewer shows: rows and columns change places, then the picture is mirrored.
struct Turn {
  bool transpose = false;
  bool flip_x = false;  // left becomes right
  bool flip_y = false;  // top becomes bottom
};

cv::Mat Turned(const cv::Mat& picture, const Turn& turn);

// Has 'capture' give the pictures of 'input' as they are stored, and says how they are to be turned. For versions of
// OpenCV turn them in different directions (opencv/opencv#22088), or not at all, and none mirrors them.
Turn TakeOverTurn(const std::string& input, cv::VideoCapture& capture);

}  // namespace holdfast
