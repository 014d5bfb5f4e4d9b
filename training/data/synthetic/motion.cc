// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/motion.h"

#include <algorithm>
#include <cmath>

#include "training/data/synthetic/scene_mix.h"

namespace holdfast {
namespace {

using mix::kPi;

cv::Point2d Apply(const cv::Matx33d& h, cv::Point2d p) {
  const double w = h(2, 0) * p.x + h(2, 1) * p.y + h(2, 2);
  return {(h(0, 0) * p.x + h(0, 1) * p.y + h(0, 2)) / w, (h(1, 0) * p.x + h(1, 1) * p.y + h(1, 2)) / w};
}

}  // namespace

double Rest::At(double clock) const {
  const double length = end - start;
  if (length <= 0) return clock;
  const double moved = clock < start ? clock : std::max(start, clock - length);
  return moved * duration / (duration - length);
}

cv::Matx33d Motion::At(double clock, double shift) const {
  const double time = rest.At(clock);
  const double angle_now = angle.At(time), scale = std::exp(log_scale.At(time));
  const double c = scale * std::cos(angle_now), s = scale * std::sin(angle_now), k = shear.At(time);
  const double tx = home.x + shift * (x.At(time) + shake_x.At(time));
  const double ty = home.y + shift * (y.At(time) + shake_y.At(time));
  const cv::Matx33d affine(c, k * c - s, tx, s, k * s + c, ty, 0, 0, 1);
  const cv::Matx33d tilt(1, 0, 0, 0, 1, 0, perspective_x.At(time), perspective_y.At(time), 1);
  const cv::Matx33d own = affine * tilt * cv::Matx33d(1, 0, -pivot.x, 0, 1, -pivot.y, 0, 0, 1);
  return parent == nullptr ? own : parent->At(clock) * own;
}

ElasticWaves ElasticWaves::Random(Rng& rng, double gradient, double size) {
  ElasticWaves elastic;
  const int count = static_cast<int>(rng.Integer(2, 3));
  for (int i = 0; i < count; ++i) {
    const double number = 2 * kPi / (size * rng.Uniform(0.6, 1.5));
    const double amplitude = gradient / count / number;
    const double heading = rng.Uniform(0, 2 * kPi), push = rng.Uniform(0, 2 * kPi);
    elastic.waves.push_back({{amplitude * std::cos(push), amplitude * std::sin(push)},
                             {number * std::cos(heading), number * std::sin(heading)},
                             rng.Uniform(0, 2 * kPi),
                             rng.Uniform(-0.5, 0.5)});
  }
  return elastic;
}

PlaneMap::PlaneMap(const cv::Matx33d& image_from_plane, const ElasticWaves& elastic, double time)
    : image_from_plane_(image_from_plane), plane_from_image_(image_from_plane.inv()), waves_(elastic.waves) {
  for (ElasticWaves::Wave& wave : waves_) wave.phase += wave.speed * time;
}

cv::Point2d PlaneMap::Displacement(cv::Point2d plane) const {
  cv::Point2d sum;
  for (const ElasticWaves::Wave& wave : waves_) sum += wave.direction * std::sin(wave.wave.dot(plane) + wave.phase);
  return sum;
}

cv::Point2d PlaneMap::ImageFromPlane(cv::Point2d plane) const {
  return Apply(image_from_plane_, plane + Displacement(plane));
}

cv::Point2d PlaneMap::PlaneFromImage(cv::Point2d image) const {
  const cv::Point2d bent = Apply(plane_from_image_, image);
  if (waves_.empty()) return bent;
  cv::Point2d plane = bent;
  // A contraction: each round divides the error by at least 1 / gradient, which is 2 or more.
  for (int round = 0; round < 24; ++round) {
    const cv::Point2d next = bent - Displacement(plane);
    const cv::Point2d step = next - plane;
    plane = next;
    if (step.dot(step) < 1e-6) break;
  }
  return plane;
}

double PlaneMap::InverseBend(cv::Point2d image) const {
  const cv::Matx33d& h = plane_from_image_;
  const cv::Point2d plane = Apply(h, image);
  const double w = h(2, 0) * image.x + h(2, 1) * image.y + h(2, 2);
  const cv::Point2d along_x((h(0, 0) - plane.x * h(2, 0)) / w, (h(1, 0) - plane.y * h(2, 0)) / w);
  const cv::Point2d along_y((h(0, 1) - plane.x * h(2, 1)) / w, (h(1, 1) - plane.y * h(2, 1)) / w);
  double bend = 0, squeeze = 0;
  for (const ElasticWaves::Wave& wave : waves_) {
    const double across_x = std::pow(wave.wave.dot(along_x), 4), across_y = std::pow(wave.wave.dot(along_y), 4);
    bend += cv::norm(wave.direction) * (across_x + across_y);
    squeeze += std::abs(wave.direction.dot(wave.wave));
  }
  // Where the forward map squeezes, the inverse is steeper, and its derivatives all the more.
  const double plane_pixels = std::sqrt(std::abs(along_x.cross(along_y)));  // for one of the image
  return bend / plane_pixels / std::pow(1 - squeeze, 5);
}

}  // namespace holdfast
