// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/lk_baseline.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

constexpr ImageSize kTextureSize = {160, 128};

ClipEstimate TrackOrDie(const LucasKanadeOptions& options, const Sample& clip, const std::vector<int64_t>& queries) {
  auto tracker = CreateLucasKanade(options);
  EXPECT_THAT(tracker, IsOk());
  auto estimate = (*tracker)->Track(clip, queries);
  EXPECT_THAT(estimate, IsOk());
  return *std::move(estimate);
}

cv::Point2f PositionIn(const ClipEstimate& estimate, const Sample& clip, int64_t frame, int64_t point) {
  const size_t at = 2 * clip.At(frame, point);
  return {estimate.positions[at], estimate.positions[at + 1]};
}

TEST(LucasKanadeTest, FollowsASlidingTexture) {
  const Sample clip = MovingTexture(8, kTextureSize, {3, -2}, {{60, 70}, {40, 90}});
  const ClipEstimate estimate = TrackOrDie({}, clip, {0, 0});
  EXPECT_EQ(estimate.processing_size, kTextureSize);
  for (int64_t t = 0; t < 8; ++t) {
    for (int64_t n = 0; n < 2; ++n) {
      EXPECT_LT(cv::norm(PositionIn(estimate, clip, t, n) - clip.Position(t, n)), 0.2) << "frame " << t;
      EXPECT_EQ(estimate.visible[clip.At(t, n)], 1);
    }
  }
}

TEST(LucasKanadeTest, BeginsAtTheQueryFrame) {
  const Sample clip = MovingTexture(6, kTextureSize, {3, 0}, {{40, 60}});
  const ClipEstimate estimate = TrackOrDie({}, clip, {3});
  EXPECT_TRUE(std::isnan(PositionIn(estimate, clip, 2, 0).x));
  EXPECT_EQ(estimate.visible[clip.At(2, 0)], 0);
  EXPECT_EQ(PositionIn(estimate, clip, 3, 0), clip.Position(3, 0));
  EXPECT_LT(cv::norm(PositionIn(estimate, clip, 5, 0) - clip.Position(5, 0)), 0.2);
}

TEST(LucasKanadeTest, AnswersInPixelsOfTheClipWhateverSizeItWorksAt) {
  const Sample clip = MovingTexture(6, kTextureSize, {4, 2}, {{50, 50}});
  LucasKanadeOptions options;
  options.processing_size = {80, 96};
  const ClipEstimate estimate = TrackOrDie(options, clip, {0});
  EXPECT_EQ(estimate.processing_size, options.processing_size);
  EXPECT_LT(cv::norm(PositionIn(estimate, clip, 5, 0) - clip.Position(5, 0)), 1);
}

TEST(LucasKanadeTest, APointThatLeavesTheFrameIsHiddenAndStaysFinite) {
  const Sample clip = MovingTexture(6, kTextureSize, {12, 0}, {{120, 60}});
  const ClipEstimate estimate = TrackOrDie({}, clip, {0});
  EXPECT_EQ(estimate.visible[clip.At(5, 0)], 0);
  EXPECT_TRUE(std::isfinite(PositionIn(estimate, clip, 5, 0).x));
}

TEST(LucasKanadeTest, APointWhoseWayBackEndsElsewhereIsHidden) {
  Sample clip = MovingTexture(3, kTextureSize, {2, 0}, {{60, 60}});
  cv::Mat covered = clip.frames[2](cv::Rect(30, 30, 70, 60));
  cv::randu(covered, 0, 255);
  LucasKanadeOptions strict;
  strict.max_round_trip_px = 0.05;
  const ClipEstimate estimate = TrackOrDie(strict, clip, {0});
  EXPECT_EQ(estimate.visible[clip.At(1, 0)], 1);
  EXPECT_EQ(estimate.visible[clip.At(2, 0)], 0);
}

TEST(LucasKanadeTest, RefusesHalfASizeAndAWindowWithoutNeighbours) {
  LucasKanadeOptions options;
  options.processing_size = {512, 0};
  EXPECT_THAT(CreateLucasKanade(options), StatusIs(absl::StatusCode::kInvalidArgument));
  options.processing_size = {};
  options.window = 1;
  EXPECT_THAT(CreateLucasKanade(options), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace holdfast
