// SPDX-License-Identifier: Apache-2.0
#include "model/ops/resize.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

// The formula, pixel by pixel, in double: place i of 'out' lies at i (in - 1) / (out - 1) of 'in'.
torch::Tensor Formula(const torch::Tensor& map, int64_t height, int64_t width) {
  const torch::Tensor wide = map.to(torch::kDouble);
  struct Axis {
    torch::Tensor first, second;  // neighbours of each output, int64
    torch::Tensor share;          // of the second ones, float64
  };
  const auto axis = [](int64_t out, int64_t in) {
    const double scale = out > 1 ? static_cast<double>(in - 1) / static_cast<double>(out - 1) : 0.0;
    const torch::Tensor at = torch::arange(out, torch::kDouble) * scale;
    const torch::Tensor first = at.floor().clamp_max(static_cast<double>(in - 1));
    return Axis{first.to(torch::kLong), (first + 1).clamp_max(in - 1).to(torch::kLong), at - first};
  };
  const Axis down = axis(height, map.size(2)), along = axis(width, map.size(3));
  const auto rows = [&](const torch::Tensor& y) {
    const torch::Tensor row = wide.index_select(2, y);
    return row.index_select(3, along.first) * (1 - along.share) + row.index_select(3, along.second) * along.share;
  };
  const torch::Tensor fy = down.share.unsqueeze(1);
  return rows(down.first) * (1 - fy) + rows(down.second) * fy;
}

struct ResizeCase {
  int64_t height, width, out_height, out_width;
};

class ResizeTest : public testing::TestWithParam<ResizeCase> {
 protected:
  static torch::Tensor Map(int64_t channels) {
    torch::manual_seed(3);
    return torch::randn({2, channels, GetParam().height, GetParam().width})
        .contiguous(torch::MemoryFormat::ChannelsLast);
  }
};

TEST_P(ResizeTest, FollowsTheFormulaInBothTypes) {
  const ResizeCase p = GetParam();
  for (const int64_t channels : {1, 20, 33}) {
    const torch::Tensor map = Map(channels);
    const torch::Tensor got = ResizeBilinear(map, p.out_height, p.out_width);
    // A place in float32 is off by up to 2^-24 of the side, and a sample by as much of the step between two pixels.
    EXPECT_LE(RelativeDifference(got, Formula(map, p.out_height, p.out_width)), 1e-4) << channels;
    const torch::Tensor half = map.to(torch::kBFloat16);
    const torch::Tensor rounded = ResizeBilinear(half, p.out_height, p.out_width);
    EXPECT_EQ(rounded.scalar_type(), torch::kBFloat16);
    // Half a unit in the last of eight bits.
    EXPECT_LE(RelativeDifference(rounded, Formula(half, p.out_height, p.out_width)), 1.0 / 256) << channels;
  }
}

TEST_P(ResizeTest, AConstantMapStaysConstantAndCornersStayWhereTheyAre) {
  const ResizeCase p = GetParam();
  const torch::Tensor flat = torch::full({1, 4, p.height, p.width}, 3.5, torch::kBFloat16);
  EXPECT_TRUE(ResizeBilinear(flat, p.out_height, p.out_width).eq(3.5).all().item<bool>());
  if (p.out_height == 1 || p.out_width == 1) return;  // only the first corner is there
  const torch::Tensor map = Map(5);
  const torch::Tensor got = ResizeBilinear(map, p.out_height, p.out_width);
  for (const bool bottom : {false, true}) {
    for (const bool right : {false, true}) {
      const auto corner = [&](const torch::Tensor& x) {
        return x.select(2, bottom ? x.size(2) - 1 : 0).select(2, right ? x.size(3) - 1 : 0);
      };
      EXPECT_LE(RelativeDifference(corner(got), corner(map)), 1e-4) << bottom << right;
    }
  }
}

TEST_P(ResizeTest, GradientsFollowTheFormula) {
  const ResizeCase p = GetParam();
  // One pixel gets the sum of weights of both signs, which cancel, and rounding is all that is left of them.
  if (p.height * p.width == 1) GTEST_SKIP() << "measured by AConstantMapStaysConstant";
  const torch::Tensor map = Map(6);
  const auto ours = [&](const auto& in) { return ResizeBilinear(in[0], p.out_height, p.out_width); };
  const auto formula = [&](const auto& in) { return Formula(in[0], p.out_height, p.out_width); };
  ExpectSameGradients(ours, formula, {map}, 1e-4);
  ExpectSameGradients(ours, formula, {map}, 2e-2, torch::kBFloat16);
}

INSTANTIATE_TEST_SUITE_P(
    Sizes, ResizeTest,
    testing::Values(ResizeCase{16, 20, 4, 5}, ResizeCase{5, 7, 10, 14}, ResizeCase{6, 6, 6, 9}, ResizeCase{1, 4, 3, 2},
                    ResizeCase{9, 9, 1, 1}, ResizeCase{1, 1, 5, 3}, ResizeCase{2, 3, 1, 7}, ResizeCase{13, 31, 7, 61},
                    ResizeCase{61, 7, 13, 31}, ResizeCase{33, 65, 17, 33},
                    // Maps of 320x576, 608x320, 1024x768 and portrait ones, down from stride 2 and up to stride 8.
                    ResizeCase{160, 288, 40, 72}, ResizeCase{80, 144, 40, 72}, ResizeCase{20, 36, 40, 72},
                    ResizeCase{304, 160, 76, 40}, ResizeCase{38, 20, 76, 40}, ResizeCase{384, 512, 96, 128},
                    ResizeCase{48, 64, 96, 128}, ResizeCase{257, 511, 129, 63}, ResizeCase{3, 511, 7, 1021}),
    [](const testing::TestParamInfo<ResizeCase>& info) {
      const ResizeCase& p = info.param;
      return std::to_string(p.height) + "x" + std::to_string(p.width) + "to" + std::to_string(p.out_height) + "x" +
             std::to_string(p.out_width);
    });

TEST(ResizeTest, IsDifferentiableInDoubleToo) {
  torch::manual_seed(4);
  const torch::Tensor map = torch::randn({2, 3, 5, 7});
  ExpectDifferentiable([](const auto& in) { return ResizeBilinear(in[0], 9, 4); }, {map});
}

TEST(ResizeTest, AMapOfTheSizeAskedForIsHandedBack) {
  const torch::Tensor map = torch::randn({1, 3, 4, 5});
  EXPECT_TRUE(ResizeBilinear(map, 4, 5).is_same(map));
}

TEST(ResizeTest, MapsAndGradientsStayChannelsLast) {
  const torch::Tensor map = torch::randn({2, 8, 8, 12}).contiguous(torch::MemoryFormat::ChannelsLast).requires_grad_();
  const torch::Tensor small = ResizeBilinear(map, 4, 6);
  EXPECT_TRUE(small.is_contiguous(torch::MemoryFormat::ChannelsLast));
  small.sum().backward();
  EXPECT_TRUE(map.grad().is_contiguous(torch::MemoryFormat::ChannelsLast));
}

TEST(ResizeTest, TakesMapsOfAnyMemoryLayout) {
  torch::manual_seed(5);
  const torch::Tensor map = torch::randn({2, 9, 6, 11});
  const torch::Tensor cut = torch::randn({2, 9, 8, 30}).slice(3, 1, 23, 2).narrow(2, 1, 6);
  EXPECT_LE(RelativeDifference(ResizeBilinear(map, 3, 5), Formula(map, 3, 5)), 1e-5);
  EXPECT_LE(RelativeDifference(ResizeBilinear(cut, 12, 5), Formula(cut, 12, 5)), 1e-5);
}

TEST(ResizeTest, SizesWithoutPixelsAreRefused) {
  EXPECT_THROW(ResizeBilinear(torch::zeros({1, 3, 0, 4}), 2, 2), c10::Error);
  EXPECT_THROW(ResizeBilinear(torch::zeros({1, 3, 4, 4}), 0, 2), c10::Error);
  EXPECT_THROW(ResizeBilinear(torch::zeros({3, 4, 4}), 2, 2), c10::Error);
}

TEST(ResizeAndJoinTest, GivesWhatJoiningTheResizedMapsGives) {
  torch::manual_seed(4);
  for (const torch::ScalarType dtype : {torch::kFloat32, torch::kBFloat16}) {
    std::vector<torch::Tensor> maps;
    std::vector<torch::Tensor> resized;
    for (const auto& [channels, height, width] : {std::array<int64_t, 3>{5, 12, 20}, {16, 6, 10}, {9, 3, 5}}) {
      maps.push_back(
          torch::randn({2, channels, height, width}).to(dtype).contiguous(torch::MemoryFormat::ChannelsLast));
      resized.push_back(ResizeBilinear(maps.back(), 6, 10));
    }
    {
      const torch::NoGradGuard no_grad;
      EXPECT_TRUE(torch::equal(ResizeAndJoin(maps, 6, 10), torch::cat(resized, 1)));
    }
    maps[1].requires_grad_();
    EXPECT_TRUE(torch::equal(ResizeAndJoin(maps, 6, 10), torch::cat(resized, 1)));
    EXPECT_TRUE(ResizeAndJoin(maps, 6, 10).requires_grad());
  }
}

}  // namespace
}  // namespace holdfast
