// SPDX-License-Identifier: Apache-2.0
#include "model/ops/correlation.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>
#include <limits>

#include "model/ops/feature_views.h"
#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

constexpr int64_t kRadius = 3;

struct Inputs {
  torch::Tensor maps;       // [S, C, H, W]
  torch::Tensor templates;  // [N, S, K, C]
  torch::Tensor xy;         // [N, S, 2]
};

// Positions on the map, on its edges and corners, beyond them, on whole pixels and far away.
Inputs MakeInputs(int64_t channels, int64_t templates) {
  torch::manual_seed(3);
  const int64_t frames = 3;
  const torch::Tensor points = torch::tensor({{7.3, 5.6},
                                              {0.0, 0.0},
                                              {18.0, 12.0},
                                              {-0.5, 4.25},
                                              {18.6, 12.4},
                                              {-3.2, -2.9},
                                              {4.0, 6.0},
                                              {25.5, 3.1},
                                              {9.999, 0.01},
                                              {-40.0, 700.0},
                                              {3.5, 15.75},
                                              {-4.01, 5.5},
                                              {22.01, 5.0},
                                              {1e9, -1e9}});
  const torch::Tensor xy = points.to(torch::kFloat32).unsqueeze(1).repeat({1, frames, 1});
  const torch::Tensor drift = torch::tensor({0.0f, 0.37f, -0.81f}).view({1, frames, 1});
  return {torch::randn({frames, channels, 13, 19}), torch::randn({xy.size(0), frames, templates, channels}),
          xy + drift};
}

// The definition: the full volume <f, F_l(y, x)> / sqrt(C), sampled bilinearly with zeros outside.
torch::Tensor FullVolume(const torch::Tensor& maps, const torch::Tensor& templates, const torch::Tensor& xy,
                         int64_t levels) {
  const int64_t side = 2 * kRadius + 1;
  const torch::Tensor steps = torch::arange(-kRadius, kRadius + 1, maps.options());
  const torch::Tensor dx = steps.view({side, 1}).expand({side, side});  // index a * 7 + b: x offset a - 3
  const torch::Tensor offsets = torch::stack({dx, dx.t()}, 2).view({1, 1, side, side, 2});
  std::vector<torch::Tensor> result;
  torch::Tensor map = maps;
  for (int64_t l = 0; l < levels; ++l) {
    if (l > 0) map = torch::avg_pool2d(map, 2);
    const torch::Tensor volume = torch::einsum("nskc,schw->nskhw", {templates, map}) / std::sqrt(double(maps.size(1)));
    const torch::Tensor size = torch::tensor({map.size(3), map.size(2)}, maps.options());
    const torch::Tensor at = xy.to(maps.scalar_type()).unsqueeze(2).unsqueeze(3) / std::pow(2.0, l) + offsets;
    const torch::Tensor grid = (at * 2 / (size - 1) - 1).flatten(0, 1);  // [N S, 7, 7, 2]
    result.push_back(
        torch::grid_sampler(volume.flatten(0, 1), grid, 0, 0, true).unflatten(0, {xy.size(0), xy.size(1)}).flatten(3));
  }
  return torch::cat(result, 3);
}

TEST(CorrelationTest, EqualsTheFullVolumeAtAndBeyondTheEdges) {
  for (const int64_t templates : {1, 2, 3}) {
    const Inputs in = MakeInputs(32, templates);
    const torch::Tensor want = FullVolume(in.maps, in.templates, in.xy, 3);
    const PyramidCells window = BuildCells(in.maps, 3);
    EXPECT_LE((Correlate(window, in.templates, in.xy, kRadius) - want).abs().max().item<float>(), 2e-5);
    EXPECT_LE((CorrelatePlain(window, in.templates, in.xy, kRadius) - want).abs().max().item<float>(), 2e-5);
  }
}

TEST(CorrelationTest, GradientsEqualThoseOfTheFullVolume) {
  for (const int64_t channels : {12, 32}) {  // with and without a tail of the vector width
    const Inputs in = MakeInputs(channels, 3);
    const auto fused = [&](const std::vector<torch::Tensor>& at) {
      return Correlate(BuildCells(at[0], 3), at[1], in.xy, kRadius);
    };
    const auto plain = [&](const std::vector<torch::Tensor>& at) { return FullVolume(at[0], at[1], in.xy, 3); };
    ExpectSameGradients(fused, plain, {in.maps, in.templates}, 1e-5);
  }
}

TEST(CorrelationTest, FallbackOfOtherDevicesIsDifferentiable) {
  const Inputs in = MakeInputs(4, 2);
  ExpectDifferentiable([&](const auto& at) { return CorrelatePlain(BuildCells(at[0], 3), at[1], in.xy, kRadius); },
                       {in.maps, in.templates});
}

TEST(CorrelationTest, HalfPrecisionMapsAreReadExactly) {
  const Inputs in = MakeInputs(36, 3);
  const torch::Tensor half = in.maps.to(torch::kBFloat16);
  const PyramidCells window = BuildCells(half, 1);
  const torch::Tensor want = FullVolume(half.to(torch::kFloat32), in.templates, in.xy, 1);
  EXPECT_LE((Correlate(window, in.templates, in.xy, kRadius) - want).abs().max().item<float>(), 2e-5);
}

TEST(CorrelationTest, SeparateFramesGiveTheSameAsOneTensor) {
  const Inputs in = MakeInputs(32, 3);
  const std::vector<FeaturePyramid> frames = BuildPyramids(in.maps, 3);
  const PyramidCells joined = JoinPyramids(frames);
  FeatureViews views;
  views.Add(frames, 6);
  views.Add(joined, in.xy.size(0) - 6);
  const torch::Tensor want = Correlate(BuildCells(in.maps, 3), in.templates, in.xy, kRadius);
  EXPECT_TRUE(torch::equal(Correlate(views, in.templates, in.xy, kRadius), want));
}

TEST(CorrelationTest, PositionsThatAreNoNumbersGiveZeros) {
  Inputs in = MakeInputs(16, 1);
  in.xy.select(2, 0).fill_(std::numeric_limits<float>::quiet_NaN());
  const PyramidCells window = BuildCells(in.maps, 2);
  EXPECT_EQ(Correlate(window, in.templates, in.xy, kRadius).abs().max().item<float>(), 0);
  EXPECT_EQ(CorrelatePlain(window, in.templates, in.xy, kRadius).nan_to_num(0).abs().max().item<float>(), 0);
}

TEST(CorrelationTest, MapTooSmallForALevelCorrelatesWithNothingThere) {
  const Inputs in = MakeInputs(16, 1);
  const PyramidCells window = BuildCells(in.maps.narrow(2, 0, 3), 3);
  EXPECT_EQ(window.sizes.back().first, 0);
  const torch::Tensor got = Correlate(window, in.templates, in.xy, kRadius);
  EXPECT_EQ(got.narrow(3, 98, 49).abs().max().item<float>(), 0);
  EXPECT_GT(got.narrow(3, 49, 49).abs().max().item<float>(), 0);
  EXPECT_LE((CorrelatePlain(window, in.templates, in.xy, kRadius) - got).abs().max().item<float>(), 2e-5);
}

}  // namespace
}  // namespace holdfast
