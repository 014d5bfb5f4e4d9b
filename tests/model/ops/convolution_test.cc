// SPDX-License-Identifier: Apache-2.0
#include "model/ops/convolution.h"

#include <gtest/gtest.h>
#include <torch/nn/modules/conv.h>
#include <torch/types.h>
#include <torch/utils.h>

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

}  // namespace
}  // namespace holdfast
