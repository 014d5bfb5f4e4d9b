// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/similarity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace holdfast {
namespace {

constexpr double kQuarterTurn = 1.5707963267948966;

Similarity Of(double scale, double rotation, double tx, double ty) {
  return {scale * std::cos(rotation), scale * std::sin(rotation), tx, ty};
}

Tolerance Pixels(double pixels) { return {0, pixels, 1}; }

// 'count' places on a grid of ten columns, ten pixels apart, moved by 'motion'.
std::vector<Displacement> Moved(int count, const Similarity& motion) {
  std::vector<Displacement> moved;
  for (int i = 0; i < count; ++i) {
    const Pixel from{10.0f * static_cast<float>(i % 10), 10.0f * static_cast<float>(i / 10)};
    moved.push_back({from, motion.Map(from)});
  }
  return moved;
}

TEST(SimilarityTest, TheWayBackEndsWhereItBegan) {
  const Similarity motion{1.2, -0.7, 30, -4};
  const Pixel back = motion.MapBack(motion.Map({17, 250}));
  EXPECT_NEAR(back.x, 17, 1e-3);
  EXPECT_NEAR(back.y, 250, 1e-3);
}

TEST(SimilarityTest, TurnsScalesAndShifts) {
  const Similarity motion = Of(2, kQuarterTurn, 10, -5);
  const Pixel at = motion.Map({3, 1});
  EXPECT_NEAR(at.x, 8, 1e-5);
  EXPECT_NEAR(at.y, 1, 1e-5);
  EXPECT_NEAR(motion.scale(), 2, 1e-12);
  EXPECT_NEAR(motion.rotation(), kQuarterTurn, 1e-12);
}

TEST(FitSimilarityTest, FindsTheMotionThatAllFollow) {
  const Similarity motion = Of(1.3, 0.4, 25, 7);
  const auto found = FitSimilarity(Moved(12, motion), Pixels(1), Similarity());
  ASSERT_TRUE(found);
  EXPECT_EQ(found->agree, 12u);
  EXPECT_NEAR(found->motion.scale(), 1.3, 1e-5);
  EXPECT_NEAR(found->motion.rotation(), 0.4, 1e-5);
  EXPECT_NEAR(found->motion.tx, 25, 1e-3);
}

// Of 40 displacements 16 go nowhere in common: far more than a mean, or a median of each coordinate, would stand.
TEST(FitSimilarityTest, FollowsTheLargestGroupThatAgrees) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> anywhere(-200, 200);
  std::vector<Displacement> moved = Moved(40, Of(0.8, -0.3, 4, 9));
  for (size_t i = 0; i < 24; ++i) moved[i * 5 % 40 + i / 8 % 2].to = {anywhere(random), anywhere(random)};
  const auto found = FitSimilarity(moved, Pixels(1.5), Similarity());
  ASSERT_TRUE(found);
  EXPECT_EQ(found->agree, 24u);
  EXPECT_NEAR(found->motion.scale(), 0.8, 1e-3);
  EXPECT_NEAR(found->motion.rotation(), -0.3, 1e-3);
}

TEST(FitSimilarityTest, SaysNothingWhereTooFewAgree) {
  EXPECT_FALSE(FitSimilarity({}, Pixels(1), Similarity()));
  EXPECT_FALSE(FitSimilarity(Moved(2, Similarity()), Pixels(1), Similarity()));
  // Twelve that agree with nobody, and two that do.
  std::vector<Displacement> scattered = Moved(14, Of(1, 0, 3, 3));
  for (size_t i = 0; i < 12; ++i) {
    scattered[i].to = {static_cast<float>(i * i * 31 % 211), static_cast<float>(i * i * i * 17 % 193)};
  }
  EXPECT_FALSE(FitSimilarity(scattered, Pixels(0.5), Similarity()));
}

TEST(FitSimilarityTest, PointsInOnePlaceTellNoTurn) {
  const std::vector<Displacement> same(8, Displacement{{5, 5}, {9, 9}});
  EXPECT_FALSE(FitSimilarity(same, Pixels(1), Similarity()));
}

// 256 displacements are 32640 pairs, of which 512 are looked at.
TEST(FitSimilarityTest, AnEvenChoiceOfPairsIsEnoughForManyPoints) {
  const Similarity motion = Of(1.1, 0.1, 300, 0);
  std::vector<Displacement> moved = Moved(256, motion);
  for (size_t i = 0; i < moved.size(); i += 2) moved[i].to = moved[i].from;  // half stay behind
  moved[0].to = motion.Map(moved[0].from);
  const auto found = FitSimilarity(moved, Pixels(1), Similarity());
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->motion.tx, 300, 1e-2);
}

}  // namespace
}  // namespace holdfast
