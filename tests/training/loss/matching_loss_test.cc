// SPDX-License-Identifier: Apache-2.0
#include "training/loss/matching_loss.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>

namespace holdfast {
namespace {

// One point at cells (x, 0) of a map of a single row, on as many frames as there are values.
ClipTargets PointAtCells(const std::vector<float>& x, int64_t stride) {
  ClipTargets targets;
  const int64_t frames = static_cast<int64_t>(x.size());
  targets.tracks = torch::zeros({1, frames, 2});
  targets.tracks.select(2, 0).copy_(torch::tensor(x) * static_cast<double>(stride));
  targets.visible = torch::ones({1, frames}, torch::kBool);
  targets.valid = targets.visible.clone();
  return targets;
}

TEST(CellsAroundTest, SpreadsAPositionBilinearly) {
  const BilinearCells cells = CellsAround(torch::tensor({1.25f, 2.5f}), 5, 10);
  EXPECT_TRUE(torch::equal(cells.index, torch::tensor({21, 22, 31, 32}, torch::kLong)));
  EXPECT_TRUE(torch::allclose(cells.weight, torch::tensor({0.375f, 0.125f, 0.375f, 0.125f})));
}

TEST(CellsAroundTest, ClampsToTheMapsEdge) {
  const BilinearCells cells = CellsAround(torch::tensor({{-3.0f, 0.0f}, {99.0f, 4.0f}}), 5, 10);
  EXPECT_EQ(cells.index[0][0].item<int64_t>(), 0);
  EXPECT_EQ(cells.weight[0][0].item<float>(), 1.0f);
  EXPECT_EQ(cells.index[1][3].item<int64_t>(), 49);
  EXPECT_EQ(cells.weight[1][3].item<float>(), 1.0f);
}

TEST(MatchingLossTest, IsTheCrossEntropyAgainstTheTrueCell) {
  // One channel, cells 0, 1, 2 in both frames; the query at cell 1 has the template 1.
  const torch::Tensor maps = torch::tensor({0.0f, 1.0f, 2.0f}).view({1, 1, 1, 3}).repeat({2, 1, 1, 1});
  const double normalizer = std::log(1 + std::exp(1.0) + std::exp(2.0));
  const double loss = MatchingLoss(maps, PointAtCells({1, 1.5}, 8), 8).item<double>();
  EXPECT_NEAR(loss, ((normalizer - 1) + (normalizer - 1.5)) / 2, 1e-6);
}

TEST(MatchingLossTest, LeavesOutFramesWhereThePointIsHidden) {
  const torch::Tensor maps = torch::tensor({0.0f, 1.0f, 2.0f}).view({1, 1, 1, 3}).repeat({2, 1, 1, 1});
  ClipTargets targets = PointAtCells({1, 0}, 8);
  targets.visible[0][1] = false;
  const double normalizer = std::log(1 + std::exp(1.0) + std::exp(2.0));
  EXPECT_NEAR(MatchingLoss(maps, targets, 8).item<double>(), normalizer - 1, 1e-6);
}

TEST(MatchingLossTest, TeachesTheMapsToMatch) {
  torch::manual_seed(1);
  torch::Tensor maps = torch::randn({2, 4, 3, 5}).contiguous(torch::MemoryFormat::ChannelsLast).requires_grad_();
  const ClipTargets targets = PointAtCells({1, 3}, 8);
  const torch::Tensor before = MatchingLoss(maps, targets, 8);
  before.backward();
  const torch::Tensor after = MatchingLoss(maps - 0.5 * maps.grad(), targets, 8);
  EXPECT_LT(after.item<float>(), before.item<float>());
}

}  // namespace
}  // namespace holdfast
