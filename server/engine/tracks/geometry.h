// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "api/types.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// Between the caller's pixels and the network's feature pixels. Resizing from W0 to W columns maps x to x W / W0, and
// feature pixels are processing pixels / stride; the centre of the first pixel is (0, 0) in all of them.
class FrameGeometry {
 public:
  FrameGeometry() = default;
  FrameGeometry(ImageSize frame, ImageSize processing, int stride)
      : frame_(frame),
        frame_from_features_x_(static_cast<double>(frame.width) * stride / processing.width),
        frame_from_features_y_(static_cast<double>(frame.height) * stride / processing.height) {}

  ImageSize frame() const { return frame_; }
  Position ToFeatures(float x, float y) const {
    return {static_cast<float>(x / frame_from_features_x_), static_cast<float>(y / frame_from_features_y_)};
  }
  float ToFrameX(Position p) const { return static_cast<float>(p.x * frame_from_features_x_); }
  float ToFrameY(Position p) const { return static_cast<float>(p.y * frame_from_features_y_); }
  // Whether a pixel of the frame is there. False for NaN.
  bool Inside(Position p) const {
    const double x = p.x * frame_from_features_x_, y = p.y * frame_from_features_y_;
    return x >= -0.5 && y >= -0.5 && x < frame_.width - 0.5 && y < frame_.height - 0.5;
  }

 private:
  ImageSize frame_;
  double frame_from_features_x_ = 1;
  double frame_from_features_y_ = 1;
};

}  // namespace holdfast
