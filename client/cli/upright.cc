// SPDX-License-Identifier: Apache-2.0
#include "client/cli/upright.h"

namespace holdfast {

cv::Mat Turned(const cv::Mat& picture, const Turn& turn) {
  cv::Mat turned = picture;
  if (turn.transpose) cv::transpose(picture, turned);
  if (!turn.flip_x && !turn.flip_y) return turned;
  cv::Mat flipped;
  cv::flip(turned, flipped, turn.flip_x && turn.flip_y ? -1 : turn.flip_x ? 1 : 0);
  return flipped;
}

Turn TurnOf(const int32_t* matrix) {
  const int32_t a = matrix[0], b = matrix[1], c = matrix[3], d = matrix[4];
  if (b == 0 && c == 0) return {false, a < 0, d < 0};
  if (a == 0 && d == 0) return {true, c < 0, b < 0};
  return {};
}

}  // namespace holdfast
