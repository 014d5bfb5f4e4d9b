// SPDX-License-Identifier: Apache-2.0
#include "training/loss/objectness_loss.h"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <limits>

#include "training/loss/losses.h"

namespace holdfast {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// One frame of 4 x 8 pixels: columns 0-3 are object 1, 4-5 object 2, 6-7 have no label.
torch::Tensor Masks() {
  return torch::tensor({1, 1, 1, 1, 2, 2, 0, 0}, torch::kInt32).view({1, 1, 8}).expand({1, 4, 8}).contiguous();
}

// Points on the single frame, all visible and valid.
ClipTargets PointsAt(const torch::Tensor& xy) {
  ClipTargets targets;
  targets.tracks = xy.view({-1, 1, 2});
  targets.visible = torch::ones({targets.tracks.size(0), 1}, torch::kBool);
  targets.valid = targets.visible.clone();
  targets.masks = Masks();
  return targets;
}

TEST(ObjectIdsTest, ReadsTheNearestPixel) {
  const torch::Tensor xy = torch::tensor({{{3.4f, 1.0f}}, {{3.6f, 1.0f}}, {{-0.4f, 3.4f}}});
  EXPECT_TRUE(torch::equal(ObjectIds(Masks(), xy).flatten(), torch::tensor({1, 2, 1}, torch::kInt32)));
}

TEST(ObjectIdsTest, ReadsTheMaskOfEachFrame) {
  const torch::Tensor masks = torch::tensor({{{5, 6}}, {{7, 8}}}, torch::kInt32);
  const torch::Tensor xy = torch::tensor({{{0.0f, 0.0f}, {1.0f, 0.0f}}, {{1.0f, 0.0f}, {0.0f, 0.0f}}});
  EXPECT_TRUE(torch::equal(ObjectIds(masks, xy), torch::tensor({{5, 8}, {6, 7}}, torch::kInt32)));
}

TEST(ObjectIdsTest, TellsPositionsOutsideAndNotFinite) {
  const torch::Tensor xy =
      torch::tensor({{{-0.6f, 1.0f}}, {{7.6f, 1.0f}}, {{1.0f, 4.0f}}, {{kNan, 1.0f}}, {{1e30f, 0.0f}}});
  EXPECT_TRUE((ObjectIds(Masks(), xy) == kOutsideFrame).all().item<bool>());
}

TEST(LeftObjectTest, CountsAnotherObjectAndTheOutside) {
  const ClipTargets targets = PointsAt(torch::tensor({{1.0f, 1.0f}, {1.0f, 1.0f}, {1.0f, 1.0f}}));
  const torch::Tensor prediction = torch::tensor({{{2.0f, 2.0f}}, {{5.0f, 1.0f}}, {{-9.0f, 1.0f}}});
  EXPECT_TRUE(torch::equal(LeftObject(prediction, targets).flatten(), torch::tensor({false, true, true})));
}

TEST(LeftObjectTest, CountsOnlyWhereTheTruthIsVisibleValidAndLabelled) {
  // hidden, not valid, truth without label, prediction without label
  ClipTargets targets = PointsAt(torch::tensor({{1.0f, 1.0f}, {1.0f, 1.0f}, {7.0f, 1.0f}, {1.0f, 1.0f}}));
  targets.visible[0][0] = false;
  targets.valid[1][0] = false;
  const torch::Tensor prediction = torch::tensor({{{5.0f, 1.0f}}, {{5.0f, 1.0f}}, {{5.0f, 1.0f}}, {{7.0f, 1.0f}}});
  EXPECT_FALSE(LeftObject(prediction, targets).any().item<bool>());
}

TEST(ObjectnessLossTest, IsTheDistanceOfThoseThatLeftOverAllValidPairs) {
  const ClipTargets targets = PointsAt(torch::tensor({{3.0f, 1.0f}, {3.0f, 1.0f}}));
  const torch::Tensor prediction = torch::tensor({{{5.0f, 2.0f}}, {{0.0f, 1.0f}}});
  EXPECT_FLOAT_EQ(ObjectnessLoss(prediction, targets).item<float>(), (2 + 1) / 2.0f);
}

TEST(ObjectnessLossTest, TellsApartPredictionsOfEqualDistanceOfWhichOneLeftItsObject) {
  const ClipTargets targets = PointsAt(torch::tensor({{2.0f, 1.0f}}));
  const torch::Tensor on_object = torch::tensor({{{0.0f, 1.0f}}});
  const torch::Tensor off_object = torch::tensor({{{4.0f, 1.0f}}});
  const LossParts on = ClipLoss({{on_object}, {}, {}}, targets, {}),
                  off = ClipLoss({{off_object}, {}, {}}, targets, {});
  EXPECT_EQ(on.distance.item<float>(), off.distance.item<float>());
  EXPECT_FLOAT_EQ(off.total.item<float>() - on.total.item<float>(), 0.15f * 2);
}

TEST(ObjectnessLossTest, LetsNoGradientThroughTheIndicator) {
  const ClipTargets targets = PointsAt(torch::tensor({{3.0f, 1.0f}, {3.0f, 1.0f}}));
  torch::Tensor prediction = torch::tensor({{{3.6f, 1.0f}}, {{3.4f, 1.0f}}}).requires_grad_();
  EXPECT_FALSE(LeftObject(prediction, targets).requires_grad());
  ObjectnessLoss(prediction, targets).backward();
  // The first has left: the gradient of |dx| / 2, exactly as without an indicator. The second, a hair before the
  // border, gets none, though moving it over the border would cost.
  EXPECT_TRUE(torch::equal(prediction.grad(), torch::tensor({{{0.5f, 0.0f}}, {{0.0f, 0.0f}}})));
}

TEST(ObjectnessLossTest, IsZeroWithoutMasks) {
  ClipTargets targets = PointsAt(torch::tensor({{1.0f, 1.0f}}));
  targets.masks = torch::Tensor();
  EXPECT_EQ(ObjectnessLoss(torch::tensor({{{5.0f, 1.0f}}}), targets).item<float>(), 0.0f);
}

}  // namespace
}  // namespace holdfast
