// SPDX-License-Identifier: Apache-2.0
#include "model/ops/sampling.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

torch::Tensor Positions(int64_t frames) {
  const torch::Tensor xy = torch::tensor({{0.0, 0.0}, {2.5, 1.25}, {6.0, 4.0}, {-3.0, 2.0}, {9.0, 3.5}, {5.9, 4.8}});
  return xy.to(torch::kFloat32).unsqueeze(1).repeat({1, frames, 1}) + torch::rand({6, frames, 2});
}

// Bilinear with positions clamped to the map.
torch::Tensor ByGrid(const torch::Tensor& maps, const torch::Tensor& xy) {
  const torch::Tensor size = torch::tensor({maps.size(3), maps.size(2)}, maps.options());
  const torch::Tensor grid = (xy.to(maps.scalar_type()) * 2 / (size - 1) - 1).transpose(0, 1).unsqueeze(2);
  return torch::grid_sampler(maps, grid, 0, 1, true).squeeze(3).permute({2, 0, 1});
}

TEST(SamplingTest, GivesThePixelItselfOnWholePositions) {
  const torch::Tensor map = torch::arange(24).to(torch::kFloat32).view({2, 3, 4});
  const FeaturePyramid pyramid = BuildPyramid(map, 1);
  const torch::Tensor got = SampleFeatures(pyramid, torch::tensor({{2.0f, 1.0f}, {0.5f, 0.0f}, {9.0f, -4.0f}}));
  EXPECT_TRUE(torch::equal(got, torch::tensor({{6.0f, 18.0f}, {0.5f, 12.5f}, {3.0f, 15.0f}})));
}

TEST(SamplingTest, GradientsEqualThoseOfAGridSampler) {
  torch::manual_seed(11);
  const torch::Tensor maps = torch::randn({3, 20, 5, 7});
  const torch::Tensor xy = Positions(3);
  const auto plain = [&](const std::vector<torch::Tensor>& in) { return ByGrid(in[0], xy); };
  const auto fused = [&](const std::vector<torch::Tensor>& in) { return SampleRows(BuildCells(in[0], 2), xy); };
  ExpectSameGradients(fused, plain, {maps}, 1e-5);
  ExpectDifferentiable(fused, {maps});  // in double: the way of other devices
  EXPECT_LE(RelativeDifference(SampleRowsPlain(BuildCells(maps, 2), xy), ByGrid(maps, xy)), 1e-5);
}

TEST(SamplingTest, NotANumberIsTakenAsZero) {
  const FeaturePyramid pyramid = BuildPyramid(torch::ones({4, 3, 3}), 1);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(torch::equal(SampleFeatures(pyramid, torch::tensor({{nan, 1.0f}})), torch::ones({1, 4})));
}

TEST(FeaturePyramidTest, LevelsAreAveragesOfFourRoundedDown) {
  const torch::Tensor map = torch::arange(15).to(torch::kFloat32).view({1, 3, 5});
  const FeaturePyramid pyramid = BuildPyramid(map, 3);
  ASSERT_EQ(pyramid.levels.size(), 3u);
  EXPECT_TRUE(torch::equal(pyramid.levels[1], torch::tensor({3.0f, 5.0f}).view({1, 2, 1})));
  EXPECT_EQ(pyramid.levels[2].numel(), 0);
  EXPECT_EQ(pyramid.bytes(), (15 + 2) * 4);
}

TEST(FeaturePyramidTest, FramesOfABatchDoNotShareMemory) {
  const auto frames = BuildPyramids(torch::randn({2, 8, 4, 6}), 2);
  for (const auto& level : frames[1].levels) {
    EXPECT_TRUE(level.is_contiguous());
    EXPECT_EQ(level.storage().nbytes(), level.nbytes());
  }
}

}  // namespace
}  // namespace holdfast
