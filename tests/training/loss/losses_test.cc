// SPDX-License-Identifier: Apache-2.0
#include "training/loss/losses.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include <cmath>
#include <string>

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// One point on three frames: (0, 0), (10, 0), (20, 0), the last frame not valid.
ClipTargets OnePoint() {
  ClipTargets targets;
  targets.tracks = torch::tensor({{{0.0f, 0.0f}, {10.0f, 0.0f}, {20.0f, 0.0f}}});
  targets.visible = torch::tensor({{true, true, false}});
  targets.valid = torch::tensor({{true, true, false}});
  return targets;
}

torch::Tensor Shifted(const ClipTargets& targets, float dx, float dy) {
  return targets.tracks + torch::tensor({dx, dy});
}

TEST(DistanceLossTest, AddsTheCoordinatesAndWeighsLaterIterationsMore) {
  const ClipTargets targets = OnePoint();
  LossOptions options;
  options.gamma = 0.5;
  // L1 of 1 + 2 after the first iteration, 0 + 4 after the second: 0.5 * 3 + 4.
  const torch::Tensor loss = DistanceLoss({Shifted(targets, 1, -2), Shifted(targets, 0, 4)}, targets, options);
  EXPECT_FLOAT_EQ(loss.item<float>(), 5.5f);
}

TEST(DistanceLossTest, PublishedFormTakesTheMeanOfCoordinatesAndOfIterations) {
  const ClipTargets targets = OnePoint();
  LossOptions options;
  options.gamma = 0.5;
  options.form = DistanceForm::kPublished;
  const torch::Tensor loss = DistanceLoss({Shifted(targets, 1, -2), Shifted(targets, 0, 4)}, targets, options);
  EXPECT_FLOAT_EQ(loss.item<float>(), 5.5f / 2 / 2);
}

TEST(DistanceLossTest, LeavesOutLabelsThatAreNotValid) {
  const ClipTargets targets = OnePoint();
  torch::Tensor prediction = targets.tracks.clone();
  prediction[0][1][0] += 6;     // valid: 6 / 2 valid frames
  prediction[0][2][0] += 1e30;  // not valid
  EXPECT_FLOAT_EQ(DistanceLoss({prediction}, targets, {}).item<float>(), 3.0f);
}

TEST(DistanceLossTest, IsZeroWhereNothingIsValid) {
  ClipTargets targets = OnePoint();
  targets.valid.zero_();
  EXPECT_EQ(DistanceLoss({Shifted(targets, 5, 5)}, targets, {}).item<float>(), 0.0f);
}

TEST(VisibilityLossTest, IsTheCrossEntropyOfValidFrames) {
  ClipTargets targets = OnePoint();
  targets.visible = torch::tensor({{true, false, true}});
  const torch::Tensor logit = torch::tensor({{2.0f, -1.0f, -50.0f}});
  const double expected = (std::log1p(std::exp(-2.0)) + std::log1p(std::exp(-1.0))) / 2;
  EXPECT_NEAR(VisibilityLoss(logit, targets).item<double>(), expected, 1e-6);
}

TEST(ClipLossTest, WeighsItsPartsAndLeavesOutWhatIsNotThere) {
  const ClipTargets targets = OnePoint();
  Prediction prediction;
  prediction.positions = {Shifted(targets, 3, 0)};
  prediction.visibility_logit = torch::zeros({1, 3});
  const LossParts parts = ClipLoss(prediction, targets, {});
  EXPECT_FLOAT_EQ(parts.distance.item<float>(), 3.0f);
  EXPECT_FLOAT_EQ(parts.objectness.item<float>(), 0.0f);  // no masks
  EXPECT_NEAR(parts.total.item<float>(), 3 + 0.05 * std::log(2.0), 1e-6);
  EXPECT_FALSE(parts.matching.defined());
  prediction.visibility_logit = torch::Tensor();
  EXPECT_FALSE(ClipLoss(prediction, targets, {}).visibility.defined());
}

TEST(ClipLossTest, AddsTheObjectPriorOfTheLastIteration) {
  ClipTargets targets = OnePoint();
  targets.masks = torch::ones({3, 2, 32}, torch::kInt32);
  targets.masks.index_put_({torch::indexing::Slice(), torch::indexing::Slice(), torch::indexing::Slice(13, 32)}, 2);
  Prediction prediction;
  prediction.positions = {Shifted(targets, 20, 0), Shifted(targets, 4, 0)};
  LossOptions options;
  options.alpha = 0.25;
  const LossParts parts = ClipLoss(prediction, targets, options);
  // In the last iteration only frame 1 (x = 14) is on the other object: 4 / 2 valid frames.
  EXPECT_FLOAT_EQ(parts.objectness.item<float>(), 2.0f);
  EXPECT_FLOAT_EQ(parts.total.item<float>(), 0.8f * 20 + 4 + 0.25f * 2);
}

TEST(DistanceFormTest, ReadsTheNamesItWrites) {
  for (const DistanceForm form : {DistanceForm::kPaper, DistanceForm::kPublished}) {
    DistanceForm read = form == DistanceForm::kPaper ? DistanceForm::kPublished : DistanceForm::kPaper;
    std::string error;
    EXPECT_TRUE(AbslParseFlag(AbslUnparseFlag(form), &read, &error)) << error;
    EXPECT_EQ(read, form);
  }
  DistanceForm form = DistanceForm::kPublished;
  std::string error;
  EXPECT_FALSE(AbslParseFlag("mine", &form, &error));
  EXPECT_EQ(form, DistanceForm::kPublished);
  EXPECT_THAT(error, HasSubstr("paper or published"));
}

}  // namespace
}  // namespace holdfast
