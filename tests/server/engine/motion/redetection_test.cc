// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/redetection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

constexpr ImageSize kScene{256, 192};
constexpr FlowPoint kSought{90.5f, 70.25f};
constexpr float kBack = 1;

GrayImage Scene(float dx, float dy, uint32_t seed = 1) { return RichTexture(kScene, dx, dy, seed); }

// The columns from 'first' on are those of the other.
void Paste(const GrayImage& other, int first, GrayImage& image) {
  for (int y = 0; y < kScene.height; ++y) {
    const auto row = static_cast<ptrdiff_t>(y) * kScene.width;
    std::copy(other.pixels.begin() + row + first, other.pixels.begin() + row + kScene.width,
              image.pixels.begin() + row + first);
  }
}

GrayImage Flat() { return {kScene, std::vector<uint8_t>(size_t{256} * 192, 90)}; }

FlowPyramidPtr PyramidOf(const GrayImage& image) { return std::make_shared<FlowPyramid>(image); }

FlowPatch QueryPatch() { return CutPatch(FlowPyramid(Scene(0, 0)), kSought); }

// Where a point is found that is thought to be at 'expected'.
FlowPoint FoundIn(const GrayImage& image, FlowPoint expected = kSought, const FlowPatch& patch = QueryPatch()) {
  std::vector<LostChain> chains{{&patch, {PyramidOf(image)}, {expected}}};
  FindAgain(absl::MakeSpan(chains), kBack);
  EXPECT_EQ(chains[0].found, chains[0].points[0].x != expected.x || chains[0].points[0].y != expected.y);
  return chains[0].points[0];
}

void ExpectFoundAt(FlowPoint found, FlowPoint expected, float tolerance = 0.15f) {
  EXPECT_NEAR(found.x, expected.x, tolerance);
  EXPECT_NEAR(found.y, expected.y, tolerance);
}

TEST(RedetectionTest, FindsAPointFarFromWhereItWasThoughtToBe) {
  for (const FlowPoint move : {FlowPoint{60, -25}, FlowPoint{-41.5f, 38.25f}, FlowPoint{9, 0}, FlowPoint{0, 0}}) {
    const FlowPoint at{kSought.x + move.x, kSought.y + move.y};
    ExpectFoundAt(FoundIn(Scene(move.x, move.y)), at);
  }
}

TEST(RedetectionTest, FindsWhatHasTurnedGrownOrShrunk) {
  const FlowPoint at{130, 100};
  const FlowPatch patch = CutPatch(FlowPyramid(ShiftedTexture(kScene, 0, 0)), kSought);
  for (const Deformation& shape : {Turned(0.4f), Turned(-0.5f), Turned(0.13f), Deformation{1.25f, 0, 0, 1.25f},
                                   Deformation{0.8f, 0, 0, 0.8f}, Deformation{1.1f, -0.3f, 0.3f, 1.1f}}) {
    ExpectFoundAt(FoundIn(DeformedTexture(kScene, kSought, at, shape), kSought, patch), at);
  }
}

TEST(RedetectionTest, OtherLightMakesNoDifference) {
  GrayImage dim = Scene(40, 20);
  for (uint8_t& pixel : dim.pixels) pixel = static_cast<uint8_t>(30 + pixel / 2);
  ExpectFoundAt(FoundIn(dim), {kSought.x + 40, kSought.y + 20});
}

TEST(RedetectionTest, APointThatIsNotThereStaysWhereItWasThoughtToBe) {
  for (uint32_t seed = 2; seed < 12; ++seed) ExpectFoundAt(FoundIn(Scene(0, 0, seed)), kSought, 0);
  ExpectFoundAt(FoundIn(Flat()), kSought, 0);
}

TEST(RedetectionTest, OfTwoPlacesThatLookAlikeNeitherIsTaken) {
  GrayImage twice = Scene(-30, 0);
  Paste(Scene(60, 0), 110, twice);
  ExpectFoundAt(FoundIn(twice), kSought, 0);
  GrayImage once = Scene(0, 0, /*seed=*/3);
  Paste(Scene(60, 0), 110, once);
  ExpectFoundAt(FoundIn(once), {kSought.x + 60, kSought.y});
}

TEST(RedetectionTest, APlaceTooFarAwayIsNotTaken) {
  GrayImage far = Scene(0, 0, /*seed=*/3);
  Paste(Scene(100, 0), 150, far);
  ExpectFoundAt(FoundIn(far), kSought, 0);
  ExpectFoundAt(FoundIn(far, {150, 90}), {kSought.x + 100, kSought.y});
}

TEST(RedetectionTest, TheFramesBeforeFollowFromThePlaceAsFarAsFlowLeads) {
  const FlowPatch patch = QueryPatch();
  const auto shift = [](size_t frame) { return 30 + 2.0f * static_cast<float>(frame); };
  std::vector<LostChain> chains{{&patch, {}, std::vector<FlowPoint>(8, kSought)}};
  for (size_t frame = 0; frame < 8; ++frame) {
    chains[0].pictures.push_back(PyramidOf(frame == 3 ? Flat() : Scene(shift(frame), 0)));
  }
  chains.push_back({&patch, {chains[0].pictures.back()}, {kSought}});
  FindAgain(absl::MakeSpan(chains), kBack);
  for (size_t frame = 0; frame < 4; ++frame) ExpectFoundAt(chains[0].points[frame], kSought, 0);
  for (size_t frame = 4; frame < 8; ++frame)
    ExpectFoundAt(chains[0].points[frame], {kSought.x + shift(frame), kSought.y}, 0.3f);
  EXPECT_EQ(chains[1].points[0].x, chains[0].points[7].x) << "of itself alone";
  EXPECT_EQ(chains[1].points[0].y, chains[0].points[7].y);
}

TEST(RedetectionTest, TheFrameThatAChainBeginsOnIsItsOwn) {
  const FlowPatch patch = QueryPatch();
  const FlowPyramidPtr still = PyramidOf(Scene(30, 0));
  std::vector<LostChain> chains{{&patch, {still, still, still}, {kSought, kSought, kSought}}};
  FindAgain(absl::MakeSpan(chains), kBack);
  ExpectFoundAt(chains[0].points[0], kSought, 0);
  ExpectFoundAt(chains[0].points[1], {kSought.x + 30, kSought.y});
}

TEST(RedetectionTest, PicturesAndPointsOfAnyKindAreTaken) {
  FindAgain({}, kBack);
  const FlowPatch patch = QueryPatch();
  for (const ImageSize size : {ImageSize{1, 1}, ImageSize{7, 300}, ImageSize{43, 44}, ImageSize{64, 48}}) {
    const FlowPyramidPtr picture = PyramidOf(ShiftedTexture(size, 0, 0, /*seed=*/4));
    const float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
    for (const FlowPoint expected : {FlowPoint{0, 0}, FlowPoint{-1e9f, 3}, FlowPoint{infinity, 3}, FlowPoint{3, nan}}) {
      std::vector<LostChain> chains{{&patch, {picture}, {expected}}};
      FindAgain(absl::MakeSpan(chains), kBack);
      EXPECT_EQ(std::isnan(chains[0].points[0].y), std::isnan(expected.y));
    }
  }
}

}  // namespace
}  // namespace holdfast
