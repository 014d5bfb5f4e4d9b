// SPDX-License-Identifier: Apache-2.0
// A synthetic scene: layers that move and bend by themselves under a moving camera, and how to make a random one.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "training/data/rng.h"
#include "training/data/synthetic/motion.h"
#include "training/data/synthetic/picture_library.h"
#include "training/data/synthetic/synthetic_options.h"

namespace holdfast {

struct Layer {
  cv::Mat texture;  // [h, w] CV_8UC4, RGBA with colours multiplied by alpha; CV_8UC3: covers all behind it
  int32_t id = 0;   // in the masks, > 0
  Motion motion;
  ElasticWaves elastic;
  double parallax = 1;   // how much of the camera's shift reaches this layer
  bool endless = false;  // mirrored beyond its edges instead of transparent

  // Texture coordinate of the plane's origin.
  cv::Point2d Centre() const { return {(texture.cols - 1) / 2.0, (texture.rows - 1) / 2.0}; }
};

struct Scene {
  cv::Size size;              // of the frame, pixels
  std::vector<Layer> layers;  // back to front; the first one is endless and RGB
  Motion camera;              // about the frame's centre
  double shutter = 0;         // of the time between frames; 0: no motion blur
  double shadow = 0;          // darkening under the objects, [0, 1]
  cv::Point shadow_shift;     // pixels

  PlaneMap MapAt(const Layer& layer, double time) const;
};

// A scene of 'options' with every motion scaled by 'motion_strength'. 'library' may be null (procedural textures).
// Errors come from unreadable pictures only.
absl::StatusOr<Scene> RandomScene(const SyntheticOptions& options, double motion_strength,
                                  const PictureLibrary* library, Rng& rng);

}  // namespace holdfast
