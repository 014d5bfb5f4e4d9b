// SPDX-License-Identifier: Apache-2.0
#include "model/ops/convolution.h"

#include <gtest/gtest.h>
#include <torch/nn/modules/conv.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <limits>

#include "model/ops/instance_norm.h"
#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

struct Case {
  int64_t channels, kernel, stride;
};

class ConvolutionTest : public testing::TestWithParam<Case> {};

// Odd numbers of maps and narrow ones included: there Debian 13's oneDNN needs help.
TEST_P(ConvolutionTest, ValuesAndGradientsEqualAtens) {
  const Case p = GetParam();
  torch::manual_seed(5);
  torch::nn::Conv2d conv(torch::nn::Conv2dOptions(p.channels, 8, p.kernel).stride(p.stride).padding(p.kernel / 2));
  UseChannelsLast(conv);
  const torch::Tensor x = torch::randn({5, p.channels, 12, 18}).contiguous(torch::MemoryFormat::ChannelsLast);
  const auto ours = [&](const auto& in) {
    conv->to(in[0].scalar_type());
    return Convolve(in[0], conv);
  };
  const auto plain = [&](const auto& in) {
    const auto wide = [](const torch::Tensor& t) { return t.to(torch::kDouble); };
    return at::conv2d(in[0], wide(conv->weight), wide(conv->bias), {p.stride, p.stride}, {p.kernel / 2, p.kernel / 2});
  };
  ExpectSameGradients(ours, plain, {x}, 1e-5);
  ASSERT_TRUE(conv->weight.grad().defined());
  const torch::NoGradGuard no_grad;
  conv->to(torch::kFloat32);
  EXPECT_LE(
      RelativeDifference(ours(std::vector<torch::Tensor>{x}), plain(std::vector<torch::Tensor>{x.to(torch::kDouble)})),
      1e-5);
}

INSTANTIATE_TEST_SUITE_P(Shapes, ConvolutionTest,
                         testing::Values(Case{8, 1, 2}, Case{8, 3, 2}, Case{24, 1, 2}, Case{24, 3, 1}, Case{3, 7, 2}));

// A kernel of one line through the layer over time, as the update block has it.
torch::Tensor ConvolveAny(const torch::Tensor& x, const torch::nn::Conv2d& conv) {
  if (conv->weight.size(2) > 1) return Convolve(x, conv);
  Conv1d line(torch::nn::Conv1dOptions(x.size(1), conv->weight.size(0), conv->weight.size(3)));
  line->weight.copy_(conv->weight.squeeze(2));
  line->bias.copy_(conv->bias);
  return Convolve(x, line);
}

struct Shape {
  int64_t channels, out_channels, height, width, kernel_height, kernel_width, stride;
};

// Widths that tiles do not divide, panels that are not full, lines of the kernel that are cut and that go together,
// maps narrower than a tile or lower than the kernel, and more rows than are computed at once; with few channels pixel
// by pixel, with 16 and more in fours of pixels, the last of which may lack some, with 32 in pairs of lines, too.
TEST(ConvolutionForwardTest, EqualsAtensAtAnyShapeAndMapByMap) {
  const torch::NoGradGuard no_grad;
  torch::manual_seed(6);
  for (const Shape& s : {Shape{5, 24, 9, 31, 3, 3, 1}, Shape{5, 20, 9, 31, 3, 3, 2}, Shape{160, 33, 7, 13, 3, 3, 1},
                         Shape{3, 8, 40, 24, 7, 7, 2}, Shape{150, 48, 1, 24, 1, 3, 1}, Shape{300, 3, 1, 5, 1, 3, 1},
                         Shape{16, 16, 2, 3, 3, 3, 1}, Shape{33, 17, 4, 1, 3, 3, 1}, Shape{37, 48, 3, 2, 3, 3, 1},
                         Shape{31, 24, 5, 9, 3, 3, 1}, Shape{2, 96, 1, 1, 3, 3, 1}, Shape{64, 64, 6, 300, 3, 3, 1},
                         Shape{20, 24, 30, 210, 3, 3, 1}}) {
    torch::nn::Conv2d conv(torch::nn::Conv2dOptions(s.channels, s.out_channels, {s.kernel_height, s.kernel_width})
                               .stride(s.stride)
                               .padding({s.kernel_height / 2, s.kernel_width / 2}));
    const torch::Tensor x =
        torch::randn({11, s.channels, s.height, s.width}).contiguous(torch::MemoryFormat::ChannelsLast);
    const auto wide = [](const torch::Tensor& t) { return t.to(torch::kDouble); };
    const torch::Tensor want = at::conv2d(wide(x), wide(conv->weight), wide(conv->bias), {s.stride, s.stride},
                                          {s.kernel_height / 2, s.kernel_width / 2});
    const torch::Tensor got = ConvolveAny(x, conv);
    EXPECT_LE(RelativeDifference(got, want), 1e-5) << s.channels << " " << s.width;
    EXPECT_TRUE(torch::equal(ConvolveAny(x.narrow(0, 7, 2), conv), got.narrow(0, 7, 2)))
        << s.channels << " " << s.width;
  }
}

// The kernel takes moments as it writes and norms as it reads, which others do one after the other.
TEST(ConvolutionForwardTest, NormsOnTheWay) {
  torch::manual_seed(7);
  torch::nn::Conv2d first(torch::nn::Conv2dOptions(6, 20, 3).stride(2).padding(1));
  torch::nn::Conv2d second(torch::nn::Conv2dOptions(20, 24, 3).padding(1));
  const torch::Tensor x = torch::randn({3, 6, 22, 37}).contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor identity = torch::randn({3, 24, 11, 19}).contiguous(torch::MemoryFormat::ChannelsLast);
  const auto chain = [&] {
    return InstanceNormReluAdd(ConvolveMeasured(ConvolveMeasured(x, first), second), identity);
  };
  ASSERT_TRUE(chain().requires_grad());
  const torch::NoGradGuard no_grad;
  const torch::Tensor between = InstanceNormRelu(Convolve(x, first));
  EXPECT_LE(RelativeDifference(chain(), InstanceNormReluAdd(Convolve(between, second), identity)), 1e-5);
  EXPECT_LE(RelativeDifference(InstanceNormRelu(ConvolveMeasured(x, first)), between), 1e-5);
}

// Channels in registers and those that are left beside them.
TEST(ConvolutionForwardTest, WhatIsNotANumberComesThroughTheNormOnTheWay) {
  const torch::NoGradGuard no_grad;
  torch::nn::Conv2d first(torch::nn::Conv2dOptions(6, 19, 3).padding(1));
  torch::nn::Conv2d second(torch::nn::Conv2dOptions(19, 8, 3).padding(1));
  const torch::Tensor x = torch::randn({1, 6, 9, 10}).contiguous(torch::MemoryFormat::ChannelsLast);
  for (const int64_t channel : {0, 18}) {
    first->bias.zero_()[channel] = std::numeric_limits<float>::quiet_NaN();
    EXPECT_TRUE(ConvolveMeasured(ConvolveMeasured(x, first), second).map.isnan().all().item<bool>());
  }
}

// Over time each row of the batch is a map with moments of its own.
TEST(ConvolutionForwardTest, NormsRowsOverTimeOnTheWay) {
  const torch::NoGradGuard no_grad;
  torch::manual_seed(8);
  Conv1d first(torch::nn::Conv1dOptions(12, 26, 3)), second(torch::nn::Conv1dOptions(26, 9, 3));
  const torch::Tensor scale = torch::arange(1, 8).view({7, 1, 1, 1});
  const torch::Tensor x = (torch::randn({7, 12, 1, 24}) * scale).contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor got = Convolve(ConvolveMeasured(Measure(x), first), second);
  const torch::Tensor want = Convolve(InstanceNormRelu(Convolve(InstanceNormRelu(x), first)), second);
  EXPECT_LE(RelativeDifference(got, want), 1e-5);
  EXPECT_TRUE(torch::equal(Convolve(ConvolveMeasured(Measure(x.narrow(0, 3, 1)), first), second), got.narrow(0, 3, 1)));
}

TEST(ConvolutionForwardTest, PackedWeightsChangeNothingAndAreForgottenWhenTheLayerChanges) {
  const torch::NoGradGuard no_grad;
  torch::manual_seed(9);
  Conv1d conv(torch::nn::Conv1dOptions(12, 26, 3));
  const torch::Tensor x = torch::randn({7, 12, 1, 24}).contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor want = Convolve(x, conv);
  PackWeights(*conv);
  EXPECT_TRUE(torch::equal(Convolve(x, conv), want));
  conv->weight.mul_(2);
  conv->bias.mul_(2);
  EXPECT_TRUE(torch::equal(Convolve(x, conv), 2 * want));
  PackWeights(*conv);
  conv->weight.set_data(conv->weight / 2);
  conv->bias.set_data(conv->bias / 2);
  EXPECT_TRUE(torch::equal(Convolve(x, conv), want));
}

}  // namespace
}  // namespace holdfast
