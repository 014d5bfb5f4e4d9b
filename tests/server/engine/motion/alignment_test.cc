// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/alignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

constexpr FlowPoint kAligned{70.5f, 60.25f};

FlowPatch PatchOfQuery() { return CutPatch(FlowPyramid(ShiftedTexture(kWidePicture, 0, 0)), kAligned); }

void ExpectAt(const std::optional<Alignment>& found, FlowPoint at, float within) {
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->at.x, at.x, within);
  EXPECT_NEAR(found->at.y, at.y, within);
}

TEST(DeformationTest, PlausibleIsWhatPicturesOfASurfaceMayDifferBy) {
  EXPECT_TRUE(Plausible({}));
  EXPECT_TRUE(Plausible(Turned(3)));
  EXPECT_TRUE(Plausible({2.9f, 0, 0, 2.9f}));
  EXPECT_FALSE(Plausible({3.1f, 0, 0, 3.1f}));
  EXPECT_TRUE(Plausible({0.35f, 0, 0, 0.35f}));
  EXPECT_FALSE(Plausible({0.3f, 0, 0, 0.3f}));
  EXPECT_TRUE(Plausible({1.5f, 0, 0, 0.55f}));
  EXPECT_FALSE(Plausible({1.5f, 0, 0, 0.45f}));
  EXPECT_TRUE(Plausible({1, 1, 0, 1}));    // singular values 1.62 and 0.62
  EXPECT_FALSE(Plausible({1, 2, 0, 1}));   // 2.41 and 0.41
  EXPECT_FALSE(Plausible({1, 0, 0, -1}));  // mirrored
  EXPECT_FALSE(Plausible({0, 0, 0, 0}));
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(Plausible({nan, 0, 0, 1}));
  EXPECT_FALSE(Plausible({1, nan, 0, 1}));
  EXPECT_FALSE(Plausible({infinity, 0, 0, infinity}));
  EXPECT_FALSE(Plausible({1e30f, 0, 0, 1e30f}));
}

TEST(AlignmentTest, FindsSurroundingsThatHaveTurnedGrownAndSheared) {
  const FlowPatch patch = PatchOfQuery();
  const FlowPoint at{82.3f, 55.1f};
  for (const Deformation& shape : {Deformation{}, Turned(0.25f), Turned(-0.25f), Deformation{1.2f, 0, 0, 1.2f},
                                   Deformation{0.85f, 0, 0, 0.85f}, Deformation{1, 0.15f, 0, 1}}) {
    const FlowPyramid now(DeformedTexture(kWidePicture, kAligned, at, shape));
    const auto found = AlignPatch(patch, now, {at.x + 1.5f, at.y - 1}, {});
    ExpectAt(found, at, 0.1f);
    EXPECT_NEAR(found->deformation.xx, shape.xx, 0.03f);
    EXPECT_NEAR(found->deformation.xy, shape.xy, 0.03f);
    EXPECT_NEAR(found->deformation.yx, shape.yx, 0.03f);
    EXPECT_NEAR(found->deformation.yy, shape.yy, 0.03f);
    EXPECT_GT(found->correlation, 0.95f);
  }
}

TEST(AlignmentTest, WhatHasChangedMuchIsFoundFromWhatItWasLast) {
  const Deformation shape = Turned(2);
  const FlowPyramid now(DeformedTexture(kWidePicture, kAligned, kAligned, shape));
  const auto lost = AlignPatch(PatchOfQuery(), now, kAligned, {});
  EXPECT_TRUE(!lost || lost->correlation < 0.8f);
  ExpectAt(AlignPatch(PatchOfQuery(), now, kAligned, Turned(1.9f)), kAligned, 0.1f);
}

TEST(AlignmentTest, LightMakesNoDifference) {
  GrayImage dim = ShiftedTexture(kWidePicture, 3.25f, -1.5f);
  for (uint8_t& pixel : dim.pixels) pixel = static_cast<uint8_t>(20 + pixel * 2 / 5);
  const auto found = AlignPatch(PatchOfQuery(), FlowPyramid(dim), kAligned, {});
  ExpectAt(found, {kAligned.x + 3.25f, kAligned.y - 1.5f}, 0.1f);
  EXPECT_GT(found->correlation, 0.97f);
}

TEST(AlignmentTest, AnotherPictureIsNotTheSame) {
  for (uint32_t seed = 5; seed < 15; ++seed) {
    const FlowPyramid other(ShiftedTexture(kWidePicture, 0, 0, seed));
    const auto found = AlignPatch(PatchOfQuery(), other, kAligned, {});
    EXPECT_TRUE(!found || found->correlation < 0.8f) << "seed " << seed;
  }
}

TEST(AlignmentTest, AtTheEdgeOfThePictureWhatIsThereDecides) {
  const FlowPyramid query(ShiftedTexture(kWidePicture, 0, 0)), now(ShiftedTexture(kWidePicture, 2, 1.5f));
  for (const FlowPoint& at : {FlowPoint{9, 60}, FlowPoint{80, 110}, FlowPoint{150, 9}}) {
    ExpectAt(AlignPatch(CutPatch(query, at), now, at, {}), {at.x + 2, at.y + 1.5f}, 1);
  }
}

TEST(AlignmentTest, WhereThereIsNothingToGoByNothingIsFound) {
  const FlowPyramid picture(ShiftedTexture(kWidePicture, 0, 0));
  const FlowPyramid flat(GrayImage{kWidePicture, std::vector<uint8_t>(size_t{160} * 120, 77)});
  EXPECT_FALSE(AlignPatch(CutPatch(flat, {50, 50}), picture, {50, 50}, {}).has_value());
  const auto in_flat = AlignPatch(PatchOfQuery(), flat, kAligned, {});
  EXPECT_TRUE(!in_flat || in_flat->correlation < 0.5f);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(AlignPatch(PatchOfQuery(), picture, {nan, 50}, {}).has_value());
  EXPECT_FALSE(AlignPatch(PatchOfQuery(), picture, kAligned, {nan, 0, 0, 1}).has_value());
  for (const FlowPoint& far : {FlowPoint{1e9f, -1e9f}, FlowPoint{1e38f, 1e38f}}) {
    const auto found = AlignPatch(PatchOfQuery(), picture, far, {});
    EXPECT_TRUE(!found || found->correlation < 0.5f);
  }
  const FlowPyramid tiny(ShiftedTexture({32, 32}, 0, 0));
  EXPECT_FALSE(AlignPatch(CutPatch(tiny, {15, 15}), tiny, {15, 15}, {}).has_value());
}

TEST(AlignmentTest, APatchOfAnyPositionIsLookedForWithoutHarm) {
  const FlowPyramid picture(ShiftedTexture(kWidePicture, 0, 0));
  FlowPatch patch = PatchOfQuery();
  for (const float at : {-1e30f, -5.0f, 27.0f, 100.0f, 1e30f}) {
    patch.at = {at, at};
    const auto found = AlignPatch(patch, picture, kAligned, {});
    EXPECT_TRUE(!found || (std::isfinite(found->at.x) && std::isfinite(found->at.y) && Plausible(found->deformation)));
  }
}

}  // namespace
}  // namespace holdfast
