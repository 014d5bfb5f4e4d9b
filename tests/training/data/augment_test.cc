// SPDX-License-Identifier: Apache-2.0
#include "training/data/augment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

cv::Vec3d ColourAt(const Sample& clip, int64_t s, cv::Point2f at) {
  cv::Mat patch;
  cv::getRectSubPix(clip.frames[static_cast<size_t>(s)], {1, 1}, at, patch);
  return patch.at<cv::Vec3b>(0, 0);
}

// Largest change of colour along any visible track.
double WorstColour(const Sample& clip) {
  double worst = 0;
  for (int64_t n = 0; n < clip.num_points(); ++n) {
    const int64_t query = clip.QueryFrame(n);
    for (int64_t s = std::max<int64_t>(query, 0); s < clip.num_frames(); ++s) {
      if (!clip.Visible(s, n)) continue;
      const cv::Vec3d d = ColourAt(clip, s, clip.Position(s, n)) - ColourAt(clip, query, clip.Position(query, n));
      worst = std::max({worst, std::abs(d[0]), std::abs(d[1]), std::abs(d[2])});
    }
  }
  return worst;
}

TEST(AugmentTest, ReversedTimeReversesEverything) {
  const Sample before = TwoObjectClip();
  Sample clip = TwoObjectClip();
  ReverseTime(clip);
  EXPECT_EQ(clip.Position(0, 1), before.Position(5, 1));
  EXPECT_EQ(clip.Visible(0, 3), before.Visible(5, 3));
  EXPECT_FALSE(clip.Visible(0, 3)) << "it left the frame before the end";
  EXPECT_EQ(cv::norm(clip.frames[1], before.frames[4], cv::NORM_INF), 0);
  ReverseTime(clip);
  EXPECT_EQ(clip.tracks, before.tracks);
}

TEST(AugmentTest, FlipsAndTranspositionMoveThePointsWithThePixels) {
  Sample clip = TwoObjectClip();
  FlipHorizontally(clip);
  EXPECT_EQ(clip.Position(0, 0), cv::Point2f(53, 10));
  EXPECT_EQ(clip.IdAt(0, clip.Position(0, 0)), 1);
  FlipVertically(clip);
  EXPECT_EQ(clip.Position(0, 0), cv::Point2f(53, 37));
  Transpose(clip);
  EXPECT_EQ(clip.Position(0, 0), cv::Point2f(37, 53));
  EXPECT_EQ(clip.size(), (ImageSize{48, 64}));
  EXPECT_EQ(clip.IdAt(0, clip.Position(0, 0)), 1);
  EXPECT_THAT(clip.Validate(), IsOk());
  EXPECT_LE(WorstColour(clip), 1);
}

TEST(AugmentTest, AWindowOfAScaledFrameHasItsPointsAtPixelCentres) {
  Sample clip = TwoObjectClip();
  const std::vector<cv::Size> scaled(6, cv::Size(128, 96));
  ScaleAndCrop(scaled, std::vector<cv::Point>(6, {5, -4}), {40, 32}, clip);
  EXPECT_EQ(clip.size(), (ImageSize{40, 32}));
  EXPECT_EQ(clip.Position(0, 0), cv::Point2f(15.5f, 24.5f));  // (10.5 * 2 - 0.5) - (5, -4)
  EXPECT_TRUE(clip.Visible(0, 0));
  EXPECT_FALSE(clip.Visible(0, 2)) << "outside of the window";
  EXPECT_TRUE(clip.Valid(0, 2));
  EXPECT_EQ(clip.IdAt(0, {3, 1}), 0) << "above the picture";
  EXPECT_EQ(clip.frames[0].at<cv::Vec3b>(1, 3), cv::Vec3b(0, 0, 0));
}

TEST(AugmentTest, EdgesOfAScaledMaskStayWhereThePointsAre) {
  constexpr int kWidth = 160, kScaledWidth = 111, kHeight = 8, kFirst = 30, kEnd = 130;
  double shift = 0;
  for (int edge = kFirst; edge < kEnd; ++edge) {
    Sample clip;
    clip.frames = {cv::Mat::zeros(kHeight, kWidth, CV_8UC3)};
    clip.masks = {cv::Mat(kHeight, kWidth, CV_32SC1, cv::Scalar(1))};
    clip.masks[0].colRange(edge, kWidth).setTo(2);
    clip.AllocatePoints(1);
    clip.SetPosition(0, 0, {static_cast<float>(edge) - 0.5f, 4});
    ScaleAndCrop({{kScaledWidth, kHeight}}, {{0, 0}}, {kScaledWidth, kHeight}, clip);
    shift += cv::countNonZero(clip.masks[0].row(4) == 1) - 0.5 - clip.Position(0, 0).x;
  }
  EXPECT_NEAR(shift / (kEnd - kFirst), 0, 0.05);
}

TEST(AugmentTest, ErasersHideWhatLiesBeneathAndChangeOverTime) {
  int64_t hidden = 0, changes = 0;
  for (uint64_t seed = 0; seed < 30; ++seed) {
    const Sample before = TwoObjectClip();
    Sample clip = TwoObjectClip();
    Rng rng(seed);
    EraseRectangles(rng, clip);
    EXPECT_THAT(clip.Validate(), IsOk());
    EXPECT_EQ(cv::norm(clip.frames[0], before.frames[0], cv::NORM_INF), 0) << "the first frame is left alone";
    for (int64_t s = 0; s < 6; ++s) {
      for (int64_t n = 0; n < 4; ++n) {
        const bool erased = clip.Inside(clip.Position(s, n)) && clip.IdAt(s, clip.Position(s, n)) == 0;
        if (erased) {
          EXPECT_FALSE(clip.Visible(s, n));
        }
        if (before.Visible(s, n) && !clip.Visible(s, n)) ++hidden;
        EXPECT_EQ(clip.Valid(s, n), before.Valid(s, n));
      }
      if (s > 1) {
        changes +=
            cv::norm(clip.masks[static_cast<size_t>(s)], clip.masks[static_cast<size_t>(s - 1)], cv::NORM_INF) > 0;
      }
    }
  }
  EXPECT_GT(hidden, 10);
  EXPECT_GT(changes, 20);
}

TEST(AugmentTest, TracksFollowTheirColoursThroughEveryGeometricChange) {
  AugmentOptions options;
  options.size = {56, 40};
  options.photometric_share = 0;
  options.min_scale = 0.9;
  const Augmenter augmenter(options);
  int64_t seen = 0;
  for (uint64_t seed = 0; seed < 60; ++seed) {
    // A texture without steep places, so that only a misplaced point changes its colour.
    Sample clip = MovingTexture(6, {128, 96}, {2, 1}, {{50, 50}, {60, 30}, {40, 40}, {70, 60}, {30, 70}});
    Rng rng(seed);
    augmenter.Apply(rng, clip);
    EXPECT_THAT(clip.Validate(), IsOk());
    EXPECT_EQ(clip.size(), options.size);
    for (int64_t n = 0; n < clip.num_points(); ++n) {
      for (int64_t s = 0; s < 6; ++s) {
        const cv::Point2f at = clip.Position(s, n);
        if (at.x < 2 || at.y < 2 || at.x > 53 || at.y > 37) clip.visible[clip.At(s, n)] = 0;  // the rim is black
        seen += clip.Visible(s, n);
      }
    }
    EXPECT_LE(WorstColour(clip), 14) << seed;
  }
  EXPECT_GT(seen, 300);
}

TEST(AugmentTest, TheSameSeedGivesTheSameClip) {
  AugmentOptions options;
  options.size = {56, 40};
  const Augmenter augmenter(options);
  Sample a = TwoObjectClip(), b = TwoObjectClip();
  Rng first(4), second(4);
  augmenter.Apply(first, a);
  augmenter.Apply(second, b);
  EXPECT_EQ(a.tracks, b.tracks);
  EXPECT_EQ(a.visible, b.visible);
  for (size_t s = 0; s < 6; ++s) EXPECT_EQ(cv::norm(a.frames[s], b.frames[s], cv::NORM_INF), 0);
}

// A compiler that makes two draws the other way round makes other clips.
TEST(AugmentTest, ASeedsChangesAreTheSameEverywhere) {
  AugmentOptions options;
  options.size = {56, 40};
  cv::Point2d cropped, drifted;
  int erased = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    Rng crop(seed), drift(seed), erase(seed);
    Sample clip = TwoObjectClip();
    CropOrScale(options.size, crop, clip);
    cropped += cv::Point2d(clip.Position(0, 0));
    clip = TwoObjectClip();
    DriftingCrop(options, drift, clip);
    drifted += cv::Point2d(clip.Position(3, 0));
    clip = TwoObjectClip();
    EraseRectangles(erase, clip);
    erased += cv::countNonZero(clip.masks[3] == 0);
  }
  EXPECT_NEAR(cropped.x, 150.8125, 1e-3);
  EXPECT_NEAR(cropped.y, 133.75, 1e-3);
  EXPECT_NEAR(drifted.x, 552.21875, 1e-3);
  EXPECT_NEAR(drifted.y, 288.09375, 1e-3);
  EXPECT_EQ(erased, 2882);
}

TEST(AugmentTest, OptionsOutsideTheirRangesAreRefused) {
  AugmentOptions options;
  EXPECT_THAT(options.Validate(), IsOk());
  options.flip_share = 1.5;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument));
  options = AugmentOptions();
  options.min_scale = 0;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument));
  options = AugmentOptions();
  options.size = {0, 8};
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace holdfast
