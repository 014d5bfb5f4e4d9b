// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/reliability.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <utility>
#include <vector>

namespace holdfast {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Optional;
using ::testing::SizeIs;

// Tolerance of numbers worked out by hand from float32 confidences.
auto Nearly(double value) { return DoubleNear(value, 1e-6); }

std::vector<Claim> Claims(const std::vector<std::pair<float, bool>>& claims) {
  std::vector<Claim> made;
  made.reserve(claims.size());
  for (const auto& [confidence, right] : claims) made.push_back({0, confidence, right});
  return made;
}

Reliability Of(const std::vector<std::pair<float, bool>>& claims) {
  const auto reliability = ComputeReliability(Claims(claims));
  EXPECT_TRUE(reliability.has_value());
  return reliability.value_or(Reliability());
}

// The number of claims in each bin.
std::vector<int64_t> Counts(const Reliability& reliability) {
  std::vector<int64_t> counts;
  for (const ReliabilityBin& bin : reliability.bins) counts.push_back(bin.claims);
  return counts;
}

TEST(ReliabilityTest, ThereIsNoneWithoutClaims) { EXPECT_FALSE(ComputeReliability({}).has_value()); }

TEST(ReliabilityTest, ConfidencesThatComeTrueAreReliable) {
  const Reliability reliability =
      Of({{1, true}, {0, false}, {0.25f, true}, {0.25f, false}, {0.25f, false}, {0.25f, false}});
  EXPECT_EQ(reliability.claims, 6);
  EXPECT_THAT(reliability.ece, Nearly(0));
  EXPECT_THAT(reliability.brier, Nearly((0.75 * 0.75 + 3 * 0.25 * 0.25) / 6));
}

TEST(ReliabilityTest, TheCalibrationErrorWeighsTheBinsByTheirClaims) {
  // Bin 2: confidence 1/4, of three claims one is right; bin 8: confidence 13/16 (of 3/4 + 1/16), none is.
  const Reliability reliability = Of({{0.25f, true}, {0.25f, false}, {0.25f, false}, {0.8125f, false}});
  EXPECT_THAT(reliability.ece, Nearly(3 / 4.0 * (1 / 3.0 - 0.25) + 1 / 4.0 * 0.8125));
  EXPECT_THAT(reliability.brier, Nearly((0.5625 + 0.0625 + 0.0625 + 0.66015625) / 4));
}

TEST(ReliabilityTest, WithinABinErrorsOfOppositeSignsCancel) {
  // Mean confidence 0.25, one of four right.
  EXPECT_THAT(Of({{0.2188f, true}, {0.2812f, false}, {0.2188f, false}, {0.2812f, false}}).ece, Nearly(0));
}

TEST(ReliabilityTest, BinsSayTheMeanConfidenceAndTheShareThatIsRight) {
  const Reliability reliability = Of({{0.5f, true}, {0.5625f, false}, {0.53125f, true}, {0.03125f, false}});
  EXPECT_THAT(Counts(reliability), ElementsAre(1, 0, 0, 0, 0, 3, 0, 0, 0, 0));
  EXPECT_THAT(reliability.bins[5].confidence, Nearly(0.53125));
  EXPECT_THAT(reliability.bins[5].right, Nearly(2 / 3.0));
  EXPECT_THAT(reliability.bins[0].confidence, Nearly(0.03125));
  EXPECT_EQ(reliability.bins[0].right, 0);
  EXPECT_EQ(reliability.bins[9].confidence, 0) << "an empty bin";
}

TEST(ReliabilityTest, ABinBeginsWithItsTenthAndTheLastHoldsCertaintyToo) {
  EXPECT_THAT(Counts(Of({{0.0f, true},
                         {0.1f, true},
                         {0.2f, true},
                         {0.3f, true},
                         {0.4f, true},
                         {0.5f, true},
                         {0.6f, true},
                         {0.7f, true},
                         {0.8f, true},
                         {0.9f, true}})),
              ElementsAre(1, 1, 1, 1, 1, 1, 1, 1, 1, 1));
  EXPECT_THAT(Counts(Of({{0.0999f, true}, {0.0f, true}})), ElementsAre(2, 0, 0, 0, 0, 0, 0, 0, 0, 0));
  EXPECT_THAT(Counts(Of({{0.8999f, true}, {1.0f, true}})), ElementsAre(0, 0, 0, 0, 0, 0, 0, 0, 1, 1));
}

TEST(ReliabilityTest, TheAreaIsTheShareOfPairsInTheRightOrder) {
  EXPECT_THAT(Of({{0.1f, false}, {0.2f, false}, {0.8f, true}, {0.9f, true}}).auc, Optional(Nearly(1)));
  EXPECT_THAT(Of({{0.9f, false}, {0.1f, true}}).auc, Optional(Nearly(0)));
  // Right 0.3 and 0.7, wrong 0.2, 0.5 and 0.6: 1 + 3 of 6 pairs.
  EXPECT_THAT(Of({{0.7f, true}, {0.5f, false}, {0.3f, true}, {0.2f, false}, {0.6f, false}}).auc,
              Optional(Nearly(4 / 6.0)));
}

TEST(ReliabilityTest, EqualConfidencesAreHalfInOrder) {
  EXPECT_THAT(Of({{0.5f, true}, {0.5f, false}, {0.5f, false}}).auc, Optional(Nearly(0.5)));
  // Right 0.5 and 0.9, wrong 0.5, 0.5 and 0.1: (2 * 0.5 + 1) + 3 of 6 pairs.
  EXPECT_THAT(Of({{0.5f, false}, {0.9f, true}, {0.5f, true}, {0.1f, false}, {0.5f, false}}).auc,
              Optional(Nearly(5 / 6.0)));
}

TEST(ReliabilityTest, ThereIsNoAreaOfOneKindOfClaimAlone) {
  EXPECT_FALSE(Of({{0.5f, true}, {0.7f, true}}).auc.has_value());
  EXPECT_FALSE(Of({{0.5f, false}}).auc.has_value());
}

// Of 512 x 256 pixels with the truth at (100, 100): one pixel in x is half a scored pixel. Confidences are the indices
// over 100.
ScoredVideo Video(int64_t frames, int64_t points) {
  ScoredVideo video;
  video.frame_size = {512, 256};
  video.frames = frames;
  video.points = points;
  video.query_frames.assign(points, 0);
  video.truth.assign(frames * points * 2, 100.0f);
  video.estimate = video.truth;
  video.valid.assign(frames * points, 1);
  video.true_visible.assign(frames * points, 1);
  for (int64_t i = 0; i < frames * points; ++i) video.confidence.push_back(static_cast<float>(i) / 100);
  return video;
}

std::vector<int64_t> IndicesOf(const std::vector<Claim>& claims) {
  std::vector<int64_t> indices;
  indices.reserve(claims.size());
  for (const Claim& claim : claims) indices.push_back(claim.index);
  return indices;
}

TEST(ClaimsTest, AMethodWithoutConfidenceClaimsNothing) {
  ScoredVideo video = Video(3, 2);
  video.confidence.clear();
  EXPECT_THAT(ClaimsOf(video), IsEmpty());
}

TEST(ClaimsTest, EachFrameAfterTheQueryIsAClaimAtItsPlace) {
  ScoredVideo video = Video(4, 2);
  video.query_frames[1] = 2;
  const std::vector<Claim> claims = ClaimsOf(video);
  EXPECT_THAT(IndicesOf(claims), ElementsAre(2, 4, 6, 7));  // point 0 in frames 1 .. 3, point 1 in frame 3
  for (const Claim& claim : claims) {
    EXPECT_EQ(claim.confidence, static_cast<float>(claim.index) / 100);
    EXPECT_TRUE(claim.right);
  }
}

TEST(ClaimsTest, FramesWithoutTruthAreNoClaims) {
  ScoredVideo video = Video(4, 1);
  video.valid[2] = 0;
  EXPECT_THAT(IndicesOf(ClaimsOf(video)), ElementsAre(1, 3));
}

TEST(ClaimsTest, AHiddenPointIsWrongHoweverClose) {
  ScoredVideo video = Video(3, 1);
  video.true_visible[2] = 0;
  video.visible = {1, 0, 0};  // what the method says of it does not matter
  const std::vector<Claim> claims = ClaimsOf(video);
  ASSERT_THAT(claims, SizeIs(2));
  EXPECT_TRUE(claims[0].right);
  EXPECT_FALSE(claims[1].right);
}

TEST(ClaimsTest, APointThatIsHiddenNobodyKnowsWhereIsWrong) {
  ScoredVideo video = Video(4, 1);
  video.valid[2] = video.true_visible[2] = 0;
  video.valid[3] = video.true_visible[3] = 0;
  video.hidden = {0, 0, 1, 0};
  const std::vector<Claim> claims = ClaimsOf(video);
  EXPECT_THAT(IndicesOf(claims), ElementsAre(1, 2)) << "nothing is known of frame 3";
  EXPECT_TRUE(claims[0].right);
  EXPECT_FALSE(claims[1].right);
}

TEST(ClaimsTest, RightIsBelowEightPixelsOfAFrameOf256) {
  const auto right = [](float dx, float dy) {
    ScoredVideo video = Video(2, 1);
    video.estimate[2] += dx;
    video.estimate[3] += dy;
    return ClaimsOf(video).at(0).right;
  };
  EXPECT_TRUE(right(15.96875f, 0));
  EXPECT_FALSE(right(16, 0)) << "8 scored pixels are not below 8";
  EXPECT_TRUE(right(0, -7.96875f));
  EXPECT_FALSE(right(0, -8));
  EXPECT_TRUE(right(9.5f, 6.25f)) << "4.75 and 6.25 scored pixels are 7.85";
  EXPECT_FALSE(right(9.75f, 6.5f)) << "4.875 and 6.5 scored pixels are 8.125";
  EXPECT_FALSE(right(std::numeric_limits<float>::quiet_NaN(), 0));
  EXPECT_FALSE(right(std::numeric_limits<float>::infinity(), 0));
}

}  // namespace
}  // namespace holdfast
