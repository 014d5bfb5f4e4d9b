// SPDX-License-Identifier: Apache-2.0
// Draws the frames and the id images of a synthetic scene.
#pragma once

#include <opencv2/core.hpp>

#include "training/data/synthetic/scene.h"

namespace holdfast {

// Borrows the scene; keeps buffers between frames, so one thread at a time.
class Renderer {
 public:
  explicit Renderer(const Scene& scene) : scene_(scene) {}

  // [H, W] CV_8UC3 RGB and [H, W] CV_32SC1 ids at the moment of frame 'time'. With a shutter the picture is the mean
  // over a stretch of time about it; the ids are of the very moment.
  void Render(double time, cv::Mat& frame, cv::Mat& ids);

 private:
  void RenderMoment(double time, cv::Mat& frame, cv::Mat* ids);
  void DrawLayer(const Layer& layer, double time, cv::Mat& frame, cv::Mat* ids);

  const Scene& scene_;
  cv::Mat map_x_, map_y_, warped_, moment_, sum_, shade_;
};

}  // namespace holdfast
