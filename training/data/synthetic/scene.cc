// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/scene.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <utility>

#include "training/data/synthetic/layer_texture.h"
#include "training/data/synthetic/scene_mix.h"

namespace holdfast {
namespace {

double Draw(mix::Range range, Rng& rng) { return rng.Uniform(range.low, range.high); }
double DrawLogarithmic(mix::Range range, Rng& rng) {
  return std::exp(rng.Uniform(std::log(range.low), std::log(range.high)));
}

// Draws the parts of one scene, in a fixed order.
class SceneMaker {
 public:
  SceneMaker(const SyntheticOptions& options, double motion, const PictureLibrary* library, Rng& rng)
      : options_(options),
        rng_(rng),
        textures_(library, options.picture_share, rng),
        duration_(static_cast<double>(options.frames - 1)),
        strength_(rng.Chance(options.still_share) ? 0 : motion),
        // Slow clips are as likely as fast ones, on a logarithmic scale.
        speed_(strength_ * DrawLogarithmic({0.25, 1}, rng)),
        deep_(rng.Chance(mix::kDeepScene)),
        swarm_(rng.Chance(mix::kSwarm)) {
    scene_.size = {options.width, options.height};
    if (rng.Chance(options.plain_share)) textures_.TurnPlain();
  }

  absl::StatusOr<Scene> Make() {
    MakeCamera();
    MakeLight();
    absl::Status made = AddBackground();
    if (made.ok()) made = AddObjects();
    if (made.ok() && deep_ && rng_.Chance(mix::kForeground)) made = AddCover(mix::kForegroundCover);
    const int64_t occluders = options_.occluders && rng_.Chance(mix::kOccluders) ? rng_.Integer(1, 2) : 0;
    for (int64_t i = 0; i < occluders && made.ok(); ++i) made = AddOccluder();
    if (!made.ok()) return made;
    return std::move(scene_);
  }

 private:
  // How things move.
  Curve Travel(double extent);
  Curve Go(double wander, double travel);
  Motion Move(mix::Extent wander, mix::Extent travel = {});
  mix::Extent ObjectTravel();
  void Pause(Motion& motion, double probability);
  void Shake(Motion& motion, double amplitude, double length);
  void Bend(Layer& layer, double probability, double size);
  // What there is.
  void MakeCamera();
  void MakeLight();
  void ChooseLooks();
  absl::Status AddBackground();
  absl::Status AddCover(mix::Range cover);
  absl::Status AddObjects();
  absl::Status AddObject(double parallax);
  absl::Status AddCreature(double parallax);
  void AddLimb(const Layer& body, const std::shared_ptr<const Motion>& motion, const cv::Mat& skin);
  absl::Status AddOccluder();
  absl::StatusOr<Layer> NewObject();
  void Add(Layer layer) {
    layer.id = static_cast<int32_t>(scene_.layers.size()) + 1;
    scene_.layers.push_back(std::move(layer));
  }
  int SmallerSide() const { return std::min(scene_.size.width, scene_.size.height); }
  cv::Size BackgroundSize() const { return {scene_.size.width * 3 / 2, scene_.size.height * 3 / 2}; }

  const SyntheticOptions& options_;
  Rng& rng_;
  LayerTextures textures_;
  const double duration_;  // frames
  const double strength_;  // of the clip's motion, [0, 1]
  const double speed_;     // the same, where slow clips are to be common
  const bool deep_;        // the background has depth
  const bool swarm_;       // many small objects
  double parallax_ = 1;    // of the foremost layer so far
  Scene scene_;
};

// From 0 straight to up to 'extent' to either side, and in some cases back again.
Curve SceneMaker::Travel(double extent) {
  const double way = extent * strength_ * Draw(mix::kTravelled, rng_);
  const double end = rng_.Chance(0.5) ? way : -way;
  if (rng_.Chance(mix::kThereAndBack)) return Curve({0, end, 0}, duration_);
  return Curve({0, end}, duration_);
}

Curve SceneMaker::Go(double wander, double travel) {
  return travel > 0 ? Travel(travel) : Curve::Wander(rng_, wander * speed_, duration_);
}

Motion SceneMaker::Move(mix::Extent wander, mix::Extent travel) {
  Motion motion;
  motion.x = Go(wander.shift * options_.width, travel.shift * options_.width);
  motion.y = Go(wander.shift * options_.height, travel.shift * options_.height);
  motion.angle = Go(wander.angle, travel.angle);
  motion.log_scale = Go(wander.log_scale, travel.log_scale);
  return motion;
}

mix::Extent SceneMaker::ObjectTravel() {
  double rest = rng_.Uniform();
  for (const auto& [share, extent] : {std::pair(mix::kTurningObject, mix::kObjectTurn),
                                      {mix::kGrowingObject, mix::kObjectGrowth},
                                      {mix::kLeavingObject, mix::kObjectLeave}}) {
    rest -= share;
    if (rest < 0) return extent;
  }
  return {};
}

void SceneMaker::Pause(Motion& motion, double probability) {
  if (!rng_.Chance(probability)) return;
  const double length = Draw(mix::kRestLength, rng_) * duration_;
  const double start = std::max(0.0, rng_.Uniform(-0.5, 1) * (duration_ - length));  // often at the clip's start
  motion.rest = {start, start + length, duration_};
}

// A new place in every frame of a stretch of 'length' of the clip.
void SceneMaker::Shake(Motion& motion, double amplitude, double length) {
  const int64_t count = std::max<int64_t>(1, static_cast<int64_t>(length * static_cast<double>(options_.frames)));
  const int64_t first = rng_.Integer(0, options_.frames - count);
  std::vector<double> x(static_cast<size_t>(options_.frames)), y(x.size());
  for (size_t i = static_cast<size_t>(first); i < static_cast<size_t>(first + count); ++i) {
    x[i] = rng_.Uniform(-amplitude, amplitude);
    y[i] = rng_.Uniform(-amplitude, amplitude);
  }
  motion.shake_x = Curve(std::move(x), duration_);
  motion.shake_y = Curve(std::move(y), duration_);
}

void SceneMaker::Bend(Layer& layer, double probability, double size) {
  constexpr double kLeastSize = 60;  // pixels of the texture; shorter waves would be ripples
  if (!rng_.Chance(probability)) return;
  layer.elastic = ElasticWaves::Random(rng_, rng_.Uniform(0.1, 0.45) * speed_, std::max(kLeastSize, size));
}

void SceneMaker::MakeCamera() {
  const mix::CameraKind* kind = &mix::kDeepCamera;
  if (!deep_) {
    kind = std::begin(mix::kCameras);
    double rest = rng_.Uniform();
    while (rest >= kind->share && kind + 1 != std::end(mix::kCameras)) rest -= kind++->share;
  }
  scene_.camera = Move(kind->wander, kind->travel);
  if (rng_.Chance(mix::kJoltedCamera)) {
    const double length = Draw(mix::kJoltLength, rng_);
    Shake(scene_.camera, rng_.Uniform(0, mix::kJolt) * SmallerSide() * strength_, length);
  } else if (rng_.Chance(mix::kTremblingCamera)) {
    Shake(scene_.camera, rng_.Uniform(0, mix::kTremble) * speed_, 1);
  }
  Pause(scene_.camera, mix::kRestingCamera);
  scene_.camera.home = {(scene_.size.width - 1) / 2.0, (scene_.size.height - 1) / 2.0};
}

void SceneMaker::MakeLight() {
  if (options_.motion_blur && rng_.Chance(mix::kMotionBlur)) scene_.shutter = Draw(mix::kShutter, rng_);
  if (options_.shadows && rng_.Chance(mix::kShadows)) scene_.shadow = rng_.Uniform(0.2, 0.6);
  scene_.shadow_shift = {static_cast<int>(rng_.Integer(-12, 12)), static_cast<int>(rng_.Integer(2, 12))};
}

// The far end of the scene and, in deep scenes, what stands before it, nearer and nearer.
absl::Status SceneMaker::AddBackground() {
  absl::StatusOr<cv::Mat> texture = textures_.Background(BackgroundSize());
  if (!texture.ok()) return texture.status();
  Layer layer;
  layer.texture = *texture;
  layer.endless = true;
  if (!deep_ && rng_.Chance(0.5)) layer.motion = Move({0.1, 0.1, 0.15});
  layer.motion.home = scene_.camera.home;
  layer.parallax = parallax_ = rng_.Uniform(0.5, 1);
  Bend(layer, deep_ ? 0 : 0.15, scene_.size.width * rng_.Uniform(0.3, 0.8));
  Add(std::move(layer));
  const int64_t covers = deep_ ? rng_.Integer(1, 3) : 0;
  absl::Status made = absl::OkStatus();
  for (int64_t i = 0; i < covers && made.ok(); ++i) made = AddCover(mix::kBehindCover);
  return made;
}

absl::Status SceneMaker::AddCover(mix::Range cover) {
  absl::StatusOr<cv::Mat> texture = textures_.Cover(BackgroundSize(), Draw(cover, rng_));
  if (!texture.ok()) return texture.status();
  Layer layer;
  layer.texture = *texture;
  layer.endless = true;
  layer.motion.home = scene_.camera.home;
  parallax_ *= Draw(mix::kCoverParallax, rng_);
  layer.parallax = parallax_;
  Add(std::move(layer));
  return absl::OkStatus();
}

void SceneMaker::ChooseLooks() {
  const double look = rng_.Uniform();
  if (look < mix::kCamouflage * options_.alike_share) {
    textures_.ShareThis(scene_.layers[0].texture);
  } else if (swarm_ || look < options_.alike_share) {
    textures_.ShareOne();
  }
}

// The last one is the nearest.
absl::Status SceneMaker::AddObjects() {
  ChooseLooks();
  const int64_t count = swarm_ ? rng_.Integer(6, 14) : rng_.Integer(2, 8);
  const double behind = std::max(1.0, parallax_);
  absl::Status made = absl::OkStatus();
  for (int64_t i = 0; i < count && made.ok(); ++i) {
    parallax_ = behind * (1 + 0.4 * static_cast<double>(i) / static_cast<double>(count));
    made = !swarm_ && rng_.Chance(mix::kCreature) ? AddCreature(parallax_) : AddObject(parallax_);
  }
  return made;
}

absl::StatusOr<Layer> SceneMaker::NewObject() {
  const mix::Range sides = swarm_ ? mix::kSwarmSide : mix::kObjectSide;
  const int side = std::max(16, static_cast<int>(SmallerSide() * DrawLogarithmic(sides, rng_)));
  absl::StatusOr<cv::Mat> texture = textures_.Object(side);
  if (!texture.ok()) return texture.status();
  Layer layer;
  layer.texture = *texture;
  layer.motion = Move(mix::kObjectWander, ObjectTravel());
  layer.motion.shear = Curve::Wander(rng_, 0.3 * speed_, duration_);
  const double tilt = 0.25 * speed_ / std::max(texture->cols, texture->rows);
  layer.motion.perspective_x = Curve::Wander(rng_, tilt, duration_);
  layer.motion.perspective_y = Curve::Wander(rng_, tilt, duration_);
  layer.motion.home = {rng_.Uniform(0.05, 0.95) * scene_.size.width, rng_.Uniform(0.05, 0.95) * scene_.size.height};
  if (rng_.Chance(mix::kTremblingObject)) Shake(layer.motion, 2 * speed_, 1);
  Pause(layer.motion, mix::kRestingObject);
  Bend(layer, 0.5, side);
  return layer;
}

absl::Status SceneMaker::AddObject(double parallax) {
  absl::StatusOr<Layer> layer = NewObject();
  if (!layer.ok()) return layer.status();
  layer->parallax = parallax;
  Add(*std::move(layer));
  return absl::OkStatus();
}

// A body with limbs behind and in front of it. It neither bends nor tilts, so that the joints stay on it and the plane
// of a limb that reaches far beyond it stays in front of the camera.
absl::Status SceneMaker::AddCreature(double parallax) {
  absl::StatusOr<Layer> body = NewObject();
  if (!body.ok()) return body.status();
  absl::StatusOr<cv::Mat> skin = textures_.Skin(std::max(body->texture.cols, body->texture.rows));
  if (!skin.ok()) return skin.status();
  body->parallax = parallax;
  body->elastic = ElasticWaves();
  body->motion.shear = body->motion.perspective_x = body->motion.perspective_y = Curve();
  const auto motion = std::make_shared<const Motion>(body->motion);
  const int64_t behind = rng_.Integer(0, 2), before = rng_.Integer(behind == 0 ? 1 : 0, 2);
  for (int64_t i = 0; i < behind; ++i) AddLimb(*body, motion, *skin);
  Add(*body);
  for (int64_t i = 0; i < before; ++i) AddLimb(*body, motion, *skin);
  return absl::OkStatus();
}

// An arm, a tail, a wing: each segment hangs on the end of the one before and swings about it, a little later than it.
void SceneMaker::AddLimb(const Layer& body, const std::shared_ptr<const Motion>& motion, const cv::Mat& skin) {
  double angle = rng_.Uniform(-mix::kPi, mix::kPi), phase = rng_.Uniform(-mix::kPi, mix::kPi);
  const double period = DrawLogarithmic(mix::kSwingPeriod, rng_), lag = rng_.Uniform(0, 1.2);
  double length = Draw(mix::kLimbLength, rng_) * std::max(body.texture.cols, body.texture.rows);
  const double thickness = Draw(mix::kLimbThickness, rng_);
  std::shared_ptr<const Motion> parent = motion;
  cv::Point2d joint(0.35 * body.texture.cols * std::cos(angle), 0.35 * body.texture.rows * std::sin(angle));
  const int64_t segments = rng_.Integer(1, 3);
  for (int64_t i = 0; i < segments; ++i, length *= 0.8, phase -= lag, angle = 0) {
    const int height = std::max(8, static_cast<int>(thickness * length));
    const cv::Size size(std::max(2 * height, static_cast<int>(length)), height);
    Layer layer;
    layer.texture = textures_.Limb(skin, size);
    layer.parallax = body.parallax;
    const double reach = (size.width - size.height) / 2.0;  // of the joints from the middle
    layer.motion.parent = parent;
    layer.motion.home = joint;
    layer.motion.pivot = {-reach, 0};
    layer.motion.angle = Curve::Swing(angle, Draw(mix::kSwing, rng_) * speed_, period, phase, duration_);
    parent = std::make_shared<const Motion>(layer.motion);
    joint = {reach, 0};
    Add(std::move(layer));
  }
}

// An object that crosses the frame in front of all others, from outside to outside, once or to and fro.
absl::Status SceneMaker::AddOccluder() {
  absl::StatusOr<Layer> layer = NewObject();
  if (!layer.ok()) return layer.status();
  const cv::Point2d centre = scene_.camera.home;
  const double heading = rng_.Uniform(0, 2 * mix::kPi);
  const cv::Point2d along(std::cos(heading), std::sin(heading)), across(-along.y, along.x);
  const double reach = 0.6 * std::hypot(scene_.size.width, scene_.size.height);
  const double velocity = 2 * reach * speed_ / (rng_.Uniform(0.4, 1.5) * duration_);
  const double middle = rng_.Uniform(0.1, 0.9) * duration_;  // when it is half way
  std::vector<double> x, y;
  for (const double time : {0.0, duration_, 0.0}) {
    x.push_back((time - middle) * velocity * along.x);
    y.push_back((time - middle) * velocity * along.y);
  }
  if (!rng_.Chance(mix::kReturningOccluder)) {
    x.pop_back();
    y.pop_back();
  }
  layer->motion.home = centre + across * rng_.Uniform(-0.3, 0.3) * reach;
  layer->motion.x = Curve(std::move(x), duration_);
  layer->motion.y = Curve(std::move(y), duration_);
  layer->parallax = 1.1 * parallax_;
  Add(*std::move(layer));
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
