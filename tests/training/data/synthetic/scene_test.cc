// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "training/data/synthetic/renderer.h"

namespace holdfast {
namespace {

constexpr int kScenes = 300;

SyntheticOptions Small() {
  SyntheticOptions options;
  options.height = 96;
  options.width = 128;
  return options;
}

Scene RandomSceneOf(size_t index, const SyntheticOptions& options = Small()) {
  Rng rng(11, index);
  return RandomScene(options, 1, nullptr, rng).value();
}

// Scenes of the first kScenes that have a layer of which 'has' is true.
template <typename Predicate>
int ScenesWith(const Predicate& has) {
  int count = 0;
  for (size_t i = 0; i < kScenes; ++i) {
    const Scene scene = RandomSceneOf(i);
    count += std::any_of(scene.layers.begin(), scene.layers.end(), [&](const Layer& l) { return has(scene, l); });
  }
  return count;
}

// The image of a short arrow at the middle of a layer.
cv::Point2d Arrow(const Scene& scene, const Layer& layer, double time) {
  const PlaneMap map = scene.MapAt(layer, time);
  return map.ImageFromPlane({1, 0}) - map.ImageFromPlane({-1, 0});
}

// Degrees by which a layer is turned in a frame against the first one, at most; a frame's turn is less than 180.
double LargestTurn(const Scene& scene, const Layer& layer) {
  double turned = 0, largest = 0;
  for (int s = 1; s < 24; ++s) {
    const cv::Point2d a = Arrow(scene, layer, s - 1), b = Arrow(scene, layer, s);
    turned += std::atan2(a.cross(b), a.dot(b)) * 180 / CV_PI;
    largest = std::max(largest, std::abs(turned));
  }
  return largest;
}

// The camera's own motion of the frame's centre in one frame at most, pixels.
double LargestStep(const Scene& scene) {
  double largest = 0;
  for (int s = 1; s < 24; ++s) {
    const cv::Matx33d step = scene.camera.At(s) - scene.camera.At(s - 1);
    largest = std::max(largest, std::hypot(step(0, 2), step(1, 2)));
  }
  return largest;
}

TEST(SceneTest, SomeBackgroundsTurnByAlmostHalfATurn) {
  const int turning = ScenesWith(
      [](const Scene& scene, const Layer& layer) { return layer.id == 1 && LargestTurn(scene, layer) > 150; });
  EXPECT_GE(turning, 3);
  EXPECT_LE(turning, kScenes / 5);
}

TEST(SceneTest, SomeCamerasZoomFarInAndSomeFarOut) {
  int in = 0, out = 0;
  for (size_t i = 0; i < kScenes; ++i) {
    const Scene scene = RandomSceneOf(i);
    double least = 1, most = 1;
    for (int s = 0; s < 24; ++s) {
      const cv::Matx33d camera = scene.camera.At(s);
      const double scale = std::hypot(camera(0, 0), camera(1, 0));
      least = std::min(least, scale);
      most = std::max(most, scale);
    }
    in += most > 1.8;
    out += least < 0.55;
  }
  EXPECT_GE(in, 2);
  EXPECT_GE(out, 2);
}

TEST(SceneTest, SomeCamerasJumpAndSomeComeToRest) {
  int jumping = 0, resting = 0;
  for (size_t i = 0; i < kScenes; ++i) {
    const Scene scene = RandomSceneOf(i);
    jumping += LargestStep(scene) > 0.06 * scene.size.height;
    resting += scene.camera.rest.end > scene.camera.rest.start;
  }
  EXPECT_GE(jumping, kScenes / 50);
  EXPECT_LE(jumping, kScenes / 3);
  EXPECT_GE(resting, kScenes / 20);
}

TEST(SceneTest, TheLayersOfADeepSceneMoveByDifferentParallax) {
  int deep = 0;
  for (size_t i = 0; i < kScenes; ++i) {
    const Scene scene = RandomSceneOf(i);
    if (!scene.layers[1].endless) continue;
    ++deep;
    EXPECT_GT(scene.layers[1].parallax, scene.layers[0].parallax);
    const cv::Mat& cover = scene.layers[1].texture;
    cv::Mat alpha;
    cv::extractChannel(cover, alpha, 3);
    const double share = cv::mean(alpha)[0] / 255;
    EXPECT_GT(share, 0.2);
    EXPECT_LT(share, 0.75);
  }
  EXPECT_GE(deep, kScenes / 15);
}

TEST(SceneTest, ManyScenesHaveLimbsAndTheirJointsHold) {
  const int with_limbs = ScenesWith([](const Scene&, const Layer& layer) { return layer.motion.parent != nullptr; });
  EXPECT_GE(with_limbs, kScenes / 6);
  for (size_t i = 0; i < 40; ++i) {
    const Scene scene = RandomSceneOf(i);
    for (const Layer& layer : scene.layers) {
      if (layer.motion.parent == nullptr) continue;
      Layer parent = layer;
      parent.motion = *layer.motion.parent;
      for (const double time : {0.0, 7.0, 23.0}) {
        const cv::Point2d joint = scene.MapAt(parent, time).ImageFromPlane(layer.motion.home);
        EXPECT_LT(cv::norm(scene.MapAt(layer, time).ImageFromPlane(layer.motion.pivot) - joint), 1e-6);
      }
    }
  }
}

TEST(SceneTest, IdsCountTheLayersFromTheBackground) {
  for (size_t i = 0; i < 40; ++i) {
    const Scene scene = RandomSceneOf(i);
    EXPECT_EQ(scene.layers[0].texture.channels(), 3);
    for (size_t k = 0; k < scene.layers.size(); ++k) EXPECT_EQ(scene.layers[k].id, static_cast<int32_t>(k) + 1);
  }
}

// A compiler that makes two draws the other way round makes other scenes.
TEST(SceneTest, ASeedsScenesAreTheSameEverywhere) {
  double camera = 0, places = 0, colours = 0;
  for (size_t i = 0; i < 60; ++i) {
    const Scene scene = RandomSceneOf(i);
    camera += scene.camera.At(9)(0, 2);
    for (const Layer& layer : scene.layers) {
      places += layer.motion.At(5)(0, 2) + 2 * layer.motion.At(5)(1, 2);
      colours += cv::mean(layer.texture)[0] / static_cast<double>(scene.layers.size());
    }
  }
  EXPECT_NEAR(camera, 3778.485, 1e-3);
  EXPECT_NEAR(places, 87534.257, 1e-3);
  EXPECT_NEAR(colours, 3376.6, 2);
}

TEST(SceneTest, WithoutMotionNothingMoves) {
  for (size_t i = 0; i < 60; ++i) {
    SyntheticOptions options = Small();
    options.occluders = false;
    Rng rng(11, i);
    const Scene scene = RandomScene(options, 0, nullptr, rng).value();
    for (const Layer& layer : scene.layers) {
      EXPECT_LT(cv::norm(scene.MapAt(layer, 23).ImageFromPlane({4, 3}) - scene.MapAt(layer, 0).ImageFromPlane({4, 3})),
                1e-9);
    }
  }
}

// How much the layers with alpha of one scene differ in their mean colours, over the first 100 scenes.
double SpreadOfColours(double alike_share) {
  SyntheticOptions options = Small();
  options.alike_share = alike_share;
  options.plain_share = 0;
  options.occluders = false;
  double spread = 0;
  for (size_t i = 0; i < 100; ++i) {
    cv::Mat colours;  // [layers, 3]
    for (const Layer& layer : RandomSceneOf(i, options).layers) {
      if (layer.texture.channels() != 4 || layer.endless) continue;
      const cv::Scalar sum = cv::sum(layer.texture);
      colours.push_back(cv::Mat(cv::Matx13d(sum[0], sum[1], sum[2]) * (255 / sum[3])));
    }
    if (colours.rows < 2) continue;
    cv::Mat mean, deviation;
    cv::meanStdDev(colours.reshape(3), mean, deviation);
    spread += cv::norm(deviation) / 100;
  }
  return spread;
}

TEST(SceneTest, ObjectsThatAreAlikeHaveSimilarColours) {
  const double varied = SpreadOfColours(0), alike = SpreadOfColours(1);
  EXPECT_LT(alike, 0.75 * varied);
  EXPECT_LT(alike, SpreadOfColours(0.34));
}

// A bar of smooth colours that swings at the end of another one.
Scene SwingingArm() {
  Scene scene;
  scene.size = {240, 200};
  scene.camera.home = {119.5, 99.5};
  Layer ground;
  ground.id = 1;
  ground.texture = cv::Mat(300, 360, CV_8UC3, cv::Scalar(10, 20, 30));
  ground.endless = true;
  ground.motion.home = scene.camera.home;
  Layer arm;
  arm.id = 2;
  arm.texture = cv::Mat(21, 61, CV_8UC4);
  for (int y = 0; y < arm.texture.rows; ++y) {
    for (int x = 0; x < arm.texture.cols; ++x) {
      arm.texture.at<cv::Vec4b>(y, x) =
          cv::Vec4b(static_cast<uint8_t>(4 * x), static_cast<uint8_t>(10 * y), static_cast<uint8_t>(250 - 3 * x), 255);
    }
  }
  Motion shoulder;
  shoulder.home = {120, 100};
  shoulder.angle = Curve::Swing(0, 0.8, 9, 0, 23);
  arm.motion.parent = std::make_shared<const Motion>(shoulder);
  arm.motion.home = {20, 0};
  arm.motion.pivot = {-25, 0};
  arm.motion.angle = Curve::Swing(0.2, 1, 7, 1, 23);
  scene.layers = {ground, arm};
  return scene;
}

TEST(SceneTest, ColoursOfASwingingLimbGoWhereItsTracksGo) {
  const Scene scene = SwingingArm();
  const Layer& arm = scene.layers[1];
  Renderer renderer(scene);
  cv::Mat frame, ids;
  double way = 0;
  for (int s = 0; s < 24; ++s) {
    renderer.Render(s, frame, ids);
    for (const cv::Point2d plane : {cv::Point2d(-20, 0), {0, 4}, {24, -3}}) {
      const cv::Point2d at = scene.MapAt(arm, s).ImageFromPlane(plane);
      ASSERT_EQ(ids.at<int32_t>(cvRound(at.y), cvRound(at.x)), arm.id) << s << plane;
      cv::Mat patch;
      cv::getRectSubPix(frame, {1, 1}, cv::Point2f(at), patch);
      const cv::Point2d texel = plane + arm.Centre();
      const cv::Vec3d expected(4 * texel.x, 10 * texel.y, 250 - 3 * texel.x);
      EXPECT_LE(cv::norm(cv::Vec3d(patch.at<cv::Vec3b>(0, 0)) - expected), 3) << s << plane;
    }
    if (s > 0) {
      way += cv::norm(scene.MapAt(arm, s).ImageFromPlane({24, 0}) - scene.MapAt(arm, s - 1).ImageFromPlane({24, 0}));
    }
  }
  EXPECT_GT(way, 200);  // pixels: it did move
}

}  // namespace
}  // namespace holdfast
