// SPDX-License-Identifier: Apache-2.0
#include "model/resize.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

torch::Tensor Plain(const torch::Tensor& map, int64_t height, int64_t width) {
  return at::upsample_bilinear2d(map, {height, width}, /*align_corners=*/true);
}

struct Case {
  int64_t height, width, out_height, out_width;
};

class ResizeTest : public testing::TestWithParam<Case> {};

TEST_P(ResizeTest, GradientsEqualAtens) {
  const Case p = GetParam();
  torch::manual_seed(3);
  const torch::Tensor map = torch::randn({3, 20, p.height, p.width}).contiguous(torch::MemoryFormat::ChannelsLast);
  const auto ours = [&](const auto& in) { return ResizeBilinear(in[0], p.out_height, p.out_width); };
  const auto plain = [&](const auto& in) { return Plain(in[0], p.out_height, p.out_width); };
  ExpectSameGradients(ours, plain, {map}, 2e-6);
  ExpectSameGradients(ours, plain, {map}, 2e-2, torch::kBFloat16);
  ExpectDifferentiable(ours, {map});
}

INSTANTIATE_TEST_SUITE_P(Sizes, ResizeTest,
                         testing::Values(Case{16, 20, 4, 5}, Case{5, 7, 10, 14}, Case{6, 6, 6, 9}, Case{1, 4, 3, 2},
                                         Case{9, 9, 1, 1}));

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

}  // namespace
}  // namespace holdfast
