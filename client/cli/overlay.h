// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "client/cli/track_table.h"

namespace holdfast {

// Draws the estimates on a frame: a disc for each visible point, a ring for each hidden one, and the way it came as a
// trail that fades with age. Each point keeps one colour for life. An object's outline, and a cross on its points that
// have left it.
class OverlayPainter {
 public:
  // 'trail_frames': length of a trail; 0: none.
  explicit OverlayPainter(int trail_frames = 20) : trail_frames_(trail_frames) {}

  // 'picture': [H, W, 3] uint8 BGR, frame number 'frame' of the video.
  void Paint(const TrackTable& table, int64_t frame, cv::Mat& picture) const;

 private:
  void PaintTrails(const TrackTable& table, int64_t frame, cv::Mat& picture) const;

  const int trail_frames_;
};

}  // namespace holdfast
