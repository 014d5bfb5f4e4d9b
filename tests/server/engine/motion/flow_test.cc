// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/flow.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

using ::testing::SizeIs;

bool SameBits(FlowPoint a, FlowPoint b) { return a.x == b.x && a.y == b.y; }

std::vector<FlowPoint> Grid() {
  std::vector<FlowPoint> points;
  for (int i = 0; i < 60; ++i) {
    points.push_back({20.25f + 12.0f * static_cast<float>(i % 10), 25.5f + 14.0f * static_cast<float>(i / 10)});
  }
  return points;
}

TEST(FlowTest, CarriesPointsAlongWithThePicture) {
  const FlowPyramid before(ShiftedTexture(kWidePicture, 0, 0)), after(ShiftedTexture(kWidePicture, 5.5f, -3.25f));
  const std::vector<FlowPoint> points = Grid();
  const std::vector<FlowStep> steps = CarryPoints(before, after, points, 2);
  ASSERT_THAT(steps, SizeIs(points.size()));
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_TRUE(steps[i].held);
    EXPECT_NEAR(steps[i].at.x, points[i].x + 5.5f, 0.1f);
    EXPECT_NEAR(steps[i].at.y, points[i].y - 3.25f, 0.1f);
  }
}

TEST(FlowTest, APointIsTheSameToTheBitAloneAndAmong60) {
  const FlowPyramid before(ShiftedTexture(kWidePicture, 0, 0)), after(ShiftedTexture(kWidePicture, 3.3f, 1.7f));
  const std::vector<FlowPoint> points = Grid();
  const std::vector<FlowStep> carried = CarryPoints(before, after, points, 2);
  const auto followed = FollowPoints(before, after, points, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const FlowStep alone = CarryPoints(before, after, {&points[i], 1}, 2).front();
    EXPECT_TRUE(SameBits(alone.at, carried[i].at));
    EXPECT_EQ(alone.held, carried[i].held);
    const auto found = FollowPoints(before, after, {&points[i], 1}, {&points[i], 1}).front();
    ASSERT_EQ(found.has_value(), followed[i].has_value());
    if (found) {
      EXPECT_TRUE(SameBits(found->at, followed[i]->at));
    }
  }
}

TEST(FlowTest, APointThatIsCoveredStaysWhereItWas) {
  GrayImage covered = ShiftedTexture(kWidePicture, 4, 0);
  Cover(covered, 50, 110, /*seed=*/9);
  const FlowPyramid before(ShiftedTexture(kWidePicture, 0, 0)), after(covered);
  const FlowPoint hidden{76, 60}, seen{25, 60};
  const auto steps = CarryPoints(before, after, {hidden, seen}, 2);
  EXPECT_FALSE(steps[0].held);
  EXPECT_TRUE(SameBits(steps[0].at, hidden));
  EXPECT_TRUE(steps[1].held);
  EXPECT_NEAR(steps[1].at.x, 29, 0.1f);
}

TEST(FlowTest, WithoutTextureNothingIsFound) {
  const FlowPyramid flat(GrayImage{kWidePicture, std::vector<uint8_t>(size_t{160} * 120, 77)});
  EXPECT_FALSE(CarryPoints(flat, flat, {{50, 50}}, 2)[0].held);
  EXPECT_FALSE(FollowPoints(flat, flat, {{50, 50}}, {{50, 50}})[0].has_value());
}

TEST(FlowTest, NotANumberIsNotFound) {
  const FlowPyramid picture(ShiftedTexture(kWidePicture, 0, 0));
  const FlowPoint nowhere{NAN, NAN}, far{1e9f, -1e9f};
  for (const FlowPoint& point : {nowhere, far}) {
    EXPECT_FALSE(CarryPoints(picture, picture, {point}, 2)[0].held);
    EXPECT_FALSE(FollowPoints(picture, picture, {{50, 50}}, {point})[0].has_value());
  }
}

TEST(FlowTest, FindsAPointNearAnEstimateToAFractionOfAPixel) {
  const FlowPyramid before(ShiftedTexture(kWidePicture, 0, 0)), now(ShiftedTexture(kWidePicture, 23.4f, 11.8f));
  const auto found = FollowPoints(before, now, {{60.5f, 40.25f}}, {{60.5f + 26, 40.25f + 9}})[0];
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->at.x, 83.9f, 0.1f);
  EXPECT_NEAR(found->at.y, 52.05f, 0.1f);
}

TEST(FlowTest, AMatchSaysHowGoodItIs) {
  const FlowPyramid before(ShiftedTexture(kWidePicture, 0, 0)), now(ShiftedTexture(kWidePicture, 4, 0)),
      other(ShiftedTexture(kWidePicture, 0, 0, /*seed=*/5));
  const FlowPoint at{60, 60};
  const auto match = FollowPoints(before, now, {at}, {at})[0];
  ASSERT_TRUE(match.has_value());
  EXPECT_NEAR(match->move, 4, 0.1f);
  EXPECT_LT(match->round_trip, 0.1f);
  EXPECT_LT(match->difference, 2);
  const auto elsewhere = FollowPoints(before, other, {at}, {at})[0];
  EXPECT_TRUE(!elsewhere || elsewhere->difference > 10) << "another picture";
}

TEST(FlowTest, APatchIsCutAroundAPointAndItsEdgeRepeatedBeyondThePicture) {
  const FlowPyramid picture(ShiftedTexture(kWidePicture, 0, 0));
  const GrayView half = picture.half();
  EXPECT_EQ(half.size, (ImageSize{80, 60}));
  // Left and upper edge of the patch, in the halved picture; 'at' is where the point is in the patch.
  const auto expect = [&](FlowPoint point, int left, int top, FlowPoint at) {
    const FlowPatch patch = CutPatch(picture, point);
    EXPECT_TRUE(SameBits(patch.at, at)) << patch.at.x << "," << patch.at.y;
    double difference = 0;
    for (int y = 0; y < FlowPatch::kSide; ++y) {
      for (int x = 0; x < FlowPatch::kSide; ++x) {
        const int column = std::clamp(left + x, 0, 79), row = std::clamp(top + y, 0, 59);
        difference += std::abs(half.pixels[row * half.stride + column] - patch.pixels[y * FlowPatch::kSide + x]);
      }
    }
    EXPECT_LT(difference / patch.pixels.size(), 4) << "at " << point.x << "," << point.y;
  };
  expect({60.5f, 40.25f}, 17, 7, {13.25f, 13.125f});
  expect({0, 119}, -13, 46, {13, 13.5f});
  expect({-20, 60}, -13, 17, {3, 13});  // beyond the picture
}

TEST(FlowTest, LooksAtFramesInTheirOwnSizeUpToAHalfMoreThanIsProcessed) {
  const ImageSize processing{512, 384};
  EXPECT_EQ(FlowSize({320, 240}, processing), processing);
  EXPECT_EQ(FlowSize({640, 480}, processing), (ImageSize{640, 480}));
  EXPECT_EQ(FlowSize({1536, 1152}, processing), (ImageSize{768, 576}));
  EXPECT_EQ(FlowSize({1024, 576}, processing), (ImageSize{886, 498}));
  EXPECT_EQ(FlowSize({576, 1024}, processing), (ImageSize{498, 886}));
  EXPECT_EQ(FlowSize({240, 320}, processing), (ImageSize{384, 512})) << "turning is turning";
  EXPECT_EQ(FlowSize({320, 576}, processing), (ImageSize{330, 594}));
  EXPECT_EQ(FlowSize({4096, 32}, processing), (ImageSize{1024, 8}));
  EXPECT_EQ(FlowSize({4096, 256}, processing), (ImageSize{1024, 64}));
}

TEST(FlowTest, NoFramesPyramidTakesMoreThanTheMost) {
  for (const ImageSize processing : {ImageSize{512, 384}, ImageSize{32, 32}, ImageSize{256, 1024}}) {
    const int64_t most = FlowPyramid::MostBytes(processing);
    EXPECT_LT(most, 3 * FlowPyramid::BytesOf({processing.width * 3 / 2, processing.height * 3 / 2}));
    for (int width = 1; width <= 8192; width = width * 5 / 4 + 1) {
      for (int height = 1; height <= 8192; height = height * 5 / 4 + 1) {
        EXPECT_LE(FlowPyramid::BytesOf(FlowSize({width, height}, processing)), most) << width << " x " << height;
      }
    }
  }
}

TEST(FlowTest, KnowsItsBytesAndWorksAtTheSmallestSize) {
  EXPECT_EQ(FlowPyramid::BytesOf({512, 384}), int64_t{554} * 426 + 298 * 234 + 170 * 138 + 106 * 90);
  const ImageSize small{32, 32};
  const FlowPyramid before(ShiftedTexture(small, 0, 0)), after(ShiftedTexture(small, 1.5f, 0));
  EXPECT_NEAR(CarryPoints(before, after, {{15, 15}}, 2)[0].at.x, 16.5f, 0.2f);
  EXPECT_TRUE(FollowPoints(before, after, {{15, 15}}, {{15, 15}})[0].has_value());
  EXPECT_EQ(before.half().pixels, nullptr);
}

}  // namespace
}  // namespace holdfast
