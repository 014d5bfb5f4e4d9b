// SPDX-License-Identifier: Apache-2.0
#include "training/warm_start.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "model/checkpoint/checkpoint.h"
#include "model/presets.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

ModelOptions Plain() {
  ModelOptions options = *PresetByName("test");
  options.context_blocks = 0;
  options.visibility_head = false;
  return options;
}

torch::Tensor Frames() {
  torch::manual_seed(5);
  return torch::randint(0, 256, {6, 48, 64, 3}).to(torch::kUInt8);
}

torch::Tensor Track(PointModelImpl& model) {
  torch::NoGradGuard no_grad;
  const torch::Tensor start = torch::tensor({{{3.0f, 3.0f}}, {{5.0f, 2.0f}}}).expand({2, 6, 2});
  return model.Unroll(model.Encode(Frames()), start, 2).positions.back();
}

TEST(WarmStartTest, TheSameNetworkIsCopied) {
  const PointModel from(Plain());
  PointModel to(Plain());
  const auto report = WarmStart(ToTensorFile(*from, torch::kFloat32, {}), {}, *to);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->copied, static_cast<int64_t>(to->parameters().size()));
  EXPECT_TRUE(report->fresh.empty());
  EXPECT_TRUE(torch::equal(Track(*PointModel(from)), Track(*to)));
}

TEST(WarmStartTest, AVisibilityHeadBeginsUndecidedAndLeavesPositionsAlone) {
  PointModel from(Plain());
  ModelOptions options = Plain();
  options.visibility_head = true;
  PointModel to(options);
  const auto report = WarmStart(ToTensorFile(*from, torch::kFloat32, {}), {}, *to);
  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->padded, ElementsAre("delta_block.dense.weight", "delta_block.dense.bias"));
  EXPECT_TRUE(torch::allclose(Track(*from), Track(*to), 0, 1e-5));
  EXPECT_EQ(to->named_parameters()["delta_block.dense.weight"][2].abs().sum().item<float>(), 0);
}

TEST(WarmStartTest, AddedAttentionBeginsNearTheIdentity) {
  PointModel from(Plain());
  ModelOptions options = Plain();
  options.context_blocks = 1;
  PointModel to(options);
  const auto report = WarmStart(ToTensorFile(*from, torch::kFloat32, {}), Frames(), *to);
  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->fresh, Contains("context.blocks.0.query.weight"));
  torch::NoGradGuard no_grad;
  const torch::Tensor plain = from->Encode(Frames()), with = to->Encode(Frames());
  const double relative = ((plain - with).norm() / plain.norm()).item<double>();
  EXPECT_LT(relative, 0.5) << "of the deviation that tokens have among each other";
  EXPECT_NEAR(with.mean().item<double>(), plain.mean().item<double>(), 0.02);
}

TEST(WarmStartTest, AnotherBlockOfAttentionBeginsAsTheIdentity) {
  ModelOptions options = *PresetByName("test");
  options.context_blocks = 1;
  PointModel from(options);
  options.context_blocks = 2;
  PointModel to(options);
  const auto report = WarmStart(ToTensorFile(*from, torch::kFloat32, {}), Frames(), *to);
  ASSERT_THAT(report, IsOk());
  EXPECT_THAT(report->fresh, Contains("context.blocks.1.query.weight"));
  EXPECT_TRUE(torch::equal(Track(*from), Track(*to)));
}

TEST(WarmStartTest, KeepsTheAttentionOfAFileThatHasIt) {
  PointModel from(*PresetByName("test"));
  PointModel to(*PresetByName("test"));
  ASSERT_THAT(WarmStart(ToTensorFile(*from, torch::kFloat32, {}), Frames(), *to), IsOk());
  EXPECT_TRUE(torch::equal(Track(*from), Track(*to)));
}

TEST(WarmStartTest, RefusesAFileOfWhichNothingFits) {
  TensorFile file;
  file.tensors["other"] = torch::zeros({3});
  PointModel to(Plain());
  EXPECT_THAT(WarmStart(file, {}, *to), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("fits")));
}

}  // namespace
}  // namespace holdfast
