// SPDX-License-Identifier: Apache-2.0
// How the plane of a layer moves and bends, and the maps between plane and image at one moment.
// Plane coordinates: pixels of the layer's texture from its centre. Image coordinates: pixels of the frame.
#pragma once

#include <opencv2/core.hpp>

#include <memory>
#include <vector>

#include "training/data/curve.h"
#include "training/data/rng.h"

namespace holdfast {

// A stretch of a clip in which a motion stands still. The rest of the clip goes by faster for it, so that the motion
// starts or stops suddenly and still does all it would have done.
struct Rest {
  double start = 0, end = 0;  // frames; equal: no rest
  double duration = 1;        // of the clip, frames, > end - start

  // How far the motion is at 'clock', in frames of a motion without rest.
  double At(double clock) const;
};

// A homography over time: perspective, scale, shear, turn, then shift.
struct Motion {
  Curve x, y;              // shift, pixels
  Curve shake_x, shake_y;  // added to the shift, pixels
  Curve angle;             // radians
  Curve log_scale;
  Curve shear;
  Curve perspective_x, perspective_y;  // 1 / pixels
  cv::Point2d home;                    // shift when all curves are 0
  cv::Point2d pivot;                   // the place of the plane that turns and scales leave alone: it comes to 'home'
  Rest rest;
  // The motion of the plane that 'home' lies in, as an upper arm's for a forearm. Null: the scene.
  std::shared_ptr<const Motion> parent;

  // 'shift' scales x, y and the shake: the parallax of a camera.
  cv::Matx33d At(double clock, double shift = 1) const;
};

// A sum of plane waves that displace a plane within itself. The bound on the gradients makes it one to one.
struct ElasticWaves {
  struct Wave {
    cv::Point2d direction;  // of the displacement, times its amplitude, pixels
    cv::Point2d wave;       // radians a pixel
    double phase = 0;       // radians
    double speed = 0;       // radians a frame
  };
  std::vector<Wave> waves;

  // Sum of amplitude times wave number is at most 'gradient' (< 1); wave lengths are about 'size' pixels.
  static ElasticWaves Random(Rng& rng, double gradient, double size);
};

// The maps of one layer at one moment. The forward map is exact, the inverse one is it to 1e-3 pixels of the plane.
class PlaneMap {
 public:
  PlaneMap(const cv::Matx33d& image_from_plane, const ElasticWaves& elastic, double time);

  cv::Point2d ImageFromPlane(cv::Point2d plane) const;
  cv::Point2d PlaneFromImage(cv::Point2d image) const;
  // What the fourth derivatives of PlaneFromImage along the two axes come to at worst about 'image', as pixels of the
  // image: how badly it is interpolated. 0: nothing bends.
  double InverseBend(cv::Point2d image) const;

 private:
  cv::Point2d Displacement(cv::Point2d plane) const;

  cv::Matx33d image_from_plane_;
  cv::Matx33d plane_from_image_;
  std::vector<ElasticWaves::Wave> waves_;  // phase holds the time already
};

}  // namespace holdfast
