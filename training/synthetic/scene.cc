// SPDX-License-Identifier: Apache-2.0
#include "training/synthetic/scene.h"

#include <algorithm>
#include <cmath>

#include "training/synthetic/layer_texture.h"

namespace holdfast {
namespace {

// Draws the parts of one scene, in a fixed order.
class SceneMaker {
 public:
  SceneMaker(const SyntheticOptions& options, double motion, const PictureLibrary* library, Rng& rng)
      : options_(options),
        rng_(rng),
        textures_(library, options.picture_share, rng),
        duration_(static_cast<double>(options.frames - 1)) {
    // Slow clips are as likely as fast ones, on a logarithmic scale.
    const double speed = std::exp(rng.Uniform(std::log(0.25), 0));
    speed_ = rng.Chance(options.still_share) ? 0 : motion * speed;
    scene_.size = {options.width, options.height};
  }

  absl::StatusOr<Scene> Make() {
    MakeCamera();
    MakeLight();
    absl::Status made = AddBackground();
    const int64_t objects = rng_.Integer(2, 8);
    for (int64_t i = 0; i < objects && made.ok(); ++i) made = AddObject(i, objects);
    const int64_t occluders = options_.occluders && rng_.Chance(0.4) ? rng_.Integer(1, 2) : 0;
    for (int64_t i = 0; i < occluders && made.ok(); ++i) made = AddOccluder();
    if (!made.ok()) return made;
    return std::move(scene_);
  }

 private:
  void MakeCamera();
  void MakeLight();
  void Shake(Motion& motion, double amplitude);
  // Shifts of up to shift times the frame, turns in radians, scales as exp(log_scale).
  Motion Wander(double shift, double angle, double log_scale);
  void Bend(Layer& layer, double probability, double size);
  absl::Status AddBackground();
  absl::Status AddObject(int64_t index, int64_t count);
  absl::Status AddOccluder();
  absl::StatusOr<Layer> NewObject();
  int32_t NextId() const { return static_cast<int32_t>(scene_.layers.size()) + 1; }

  const SyntheticOptions& options_;
  Rng& rng_;
  LayerTextures textures_;
  const double duration_;  // frames
  double speed_ = 0;
  Scene scene_;
};

Motion SceneMaker::Wander(double shift, double angle, double log_scale) {
  Motion motion;
  motion.x = Curve::Wander(rng_, shift * speed_ * options_.width, duration_);
  motion.y = Curve::Wander(rng_, shift * speed_ * options_.height, duration_);
  motion.angle = Curve::Wander(rng_, angle * speed_, duration_);
  motion.log_scale = Curve::Wander(rng_, log_scale * speed_, duration_);
  return motion;
}

void SceneMaker::Shake(Motion& motion, double amplitude) {
  const int knots = static_cast<int>(options_.frames);
  motion.shake_x = Curve::Random(rng_, knots, amplitude, duration_);
  motion.shake_y = Curve::Random(rng_, knots, amplitude, duration_);
}

void SceneMaker::MakeCamera() {
  const double kind = rng_.Uniform();
  if (kind < 0.35) {
    scene_.camera = Motion();
  } else if (kind < 0.75) {
    scene_.camera = Wander(0.08, 0.05, 0.1);
  } else {
    scene_.camera = Wander(0.3, 0.3, 0.4);
  }
  if (rng_.Chance(0.25)) Shake(scene_.camera, rng_.Uniform(0, 2.5) * speed_);
  scene_.camera.home = {(scene_.size.width - 1) / 2.0, (scene_.size.height - 1) / 2.0};
}

void SceneMaker::MakeLight() {
  if (options_.motion_blur && rng_.Chance(0.15)) scene_.shutter = rng_.Uniform(0.2, 0.8);
  if (options_.shadows && rng_.Chance(0.3)) scene_.shadow = rng_.Uniform(0.2, 0.6);
  scene_.shadow_shift = {static_cast<int>(rng_.Integer(-12, 12)), static_cast<int>(rng_.Integer(2, 12))};
}

void SceneMaker::Bend(Layer& layer, double probability, double size) {
  if (!rng_.Chance(probability)) return;
  layer.elastic = ElasticWaves::Random(rng_, rng_.Uniform(0.1, 0.45) * speed_, size);
}

absl::Status SceneMaker::AddBackground() {
  const cv::Size size(scene_.size.width * 3 / 2, scene_.size.height * 3 / 2);
  absl::StatusOr<cv::Mat> texture = textures_.Background(size);
  if (!texture.ok()) return texture.status();
  Layer layer;
  layer.texture = *texture;
  layer.id = NextId();
  layer.endless = true;
  if (rng_.Chance(0.5)) layer.motion = Wander(0.1, 0.1, 0.15);
  layer.motion.home = scene_.camera.home;
  layer.parallax = rng_.Uniform(0.5, 1);
  Bend(layer, 0.15, scene_.size.width * rng_.Uniform(0.3, 0.8));
  scene_.layers.push_back(std::move(layer));
  return absl::OkStatus();
}

absl::StatusOr<Layer> SceneMaker::NewObject() {
  const double frame_side = std::min(scene_.size.width, scene_.size.height);
  const int side = std::max(16, static_cast<int>(frame_side * std::exp(rng_.Uniform(std::log(0.15), std::log(0.8)))));
  absl::StatusOr<cv::Mat> texture = textures_.Object(side);
  if (!texture.ok()) return texture.status();
  Layer layer;
  layer.texture = *texture;
  layer.id = NextId();
  layer.motion = Wander(0.4, 1.2, std::log(1.6));
  layer.motion.shear = Curve::Wander(rng_, 0.3 * speed_, duration_);
  const double tilt = 0.25 * speed_ / std::max(texture->cols, texture->rows);
  layer.motion.perspective_x = Curve::Wander(rng_, tilt, duration_);
  layer.motion.perspective_y = Curve::Wander(rng_, tilt, duration_);
  layer.motion.home = {rng_.Uniform(0.05, 0.95) * scene_.size.width, rng_.Uniform(0.05, 0.95) * scene_.size.height};
  Bend(layer, 0.5, side);
  return layer;
}

absl::Status SceneMaker::AddObject(int64_t index, int64_t count) {
  if (index == 0) {
    const double look = rng_.Uniform();
    if (look < 0.25) textures_.ShareOne();
    if (look > 0.93) textures_.ShareThis(scene_.layers[0].texture);  // camouflage
  }
  absl::StatusOr<Layer> layer = NewObject();
  if (!layer.ok()) return layer.status();
  layer->parallax = 1 + 0.4 * static_cast<double>(index) / static_cast<double>(count);  // the front is nearer
  if (rng_.Chance(0.1)) Shake(layer->motion, 2 * speed_);
  scene_.layers.push_back(*std::move(layer));
  return absl::OkStatus();
}

// An object that crosses the frame in front of all others, from outside to outside, once.
absl::Status SceneMaker::AddOccluder() {
  absl::StatusOr<Layer> layer = NewObject();
  if (!layer.ok()) return layer.status();
  const cv::Point2d centre = scene_.camera.home;
  const double heading = rng_.Uniform(0, 6.283185307179586);
  const cv::Point2d along(std::cos(heading), std::sin(heading)), across(-along.y, along.x);
  const double reach = 0.6 * std::hypot(scene_.size.width, scene_.size.height);
  const double frames_to_cross = rng_.Uniform(0.4, 1.5) * duration_ / std::max(speed_, 1e-3);
  const double middle = rng_.Uniform(0.1, 0.9) * duration_;  // when it is half way
  const double velocity = 2 * reach / frames_to_cross;
  const double start = -middle * velocity, end = (duration_ - middle) * velocity;
  layer->motion.home = centre + across * rng_.Uniform(-0.3, 0.3) * reach;
  layer->motion.x = Curve({start * along.x, end * along.x}, duration_);
  layer->motion.y = Curve({start * along.y, end * along.y}, duration_);
  layer->parallax = 1.5;
  scene_.layers.push_back(*std::move(layer));
  return absl::OkStatus();
}

}  // namespace

PlaneMap Scene::MapAt(const Layer& layer, double time) const {
  const cv::Matx33d to_centre(1, 0, -camera.home.x, 0, 1, -camera.home.y, 0, 0, 1);
  return PlaneMap(camera.At(time, layer.parallax) * to_centre * layer.motion.At(time), layer.elastic, time);
}

absl::StatusOr<Scene> RandomScene(const SyntheticOptions& options, double motion_strength,
                                  const PictureLibrary* library, Rng& rng) {
  return SceneMaker(options, motion_strength, library, rng).Make();
}

}  // namespace holdfast
