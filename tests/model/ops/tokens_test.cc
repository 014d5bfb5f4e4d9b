// SPDX-License-Identifier: Apache-2.0
#include "model/ops/tokens.h"

#include <gtest/gtest.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

torch::Tensor TokenMap(int64_t channels) {
  torch::manual_seed(11);
  return (torch::randn({2, channels, 5, 7}) * 3 + 2).contiguous(torch::MemoryFormat::ChannelsLast);
}

torch::nn::LayerNorm RandomLayerNorm(int64_t channels) {
  torch::nn::LayerNorm norm(torch::nn::LayerNormOptions({channels}).eps(1e-5));
  norm->weight.data().copy_(torch::randn({channels}));
  norm->bias.data().copy_(torch::randn({channels}));
  return norm;
}

torch::Tensor NormedByDefinition(const torch::Tensor& map, const torch::nn::LayerNorm& norm) {
  const torch::Tensor x = map.to(torch::kDouble);
  const torch::Tensor centred = x - x.mean({1}, true);
  const auto spread = [](const torch::Tensor& t) { return t.to(torch::kDouble).view({1, -1, 1, 1}); };
  return centred / (centred.square().mean({1}, true) + 1e-5).sqrt() * spread(norm->weight) + spread(norm->bias);
}

TEST(TokensTest, NormsThePixelsOfAMapWithAndWithoutAGradient) {
  for (const int64_t channels : {16, 61, 128}) {
    torch::nn::LayerNorm norm = RandomLayerNorm(channels);
    const torch::Tensor map = TokenMap(channels);
    ASSERT_TRUE(NormChannels(map, norm).requires_grad());
    EXPECT_LE(RelativeDifference(NormChannels(map, norm).detach(), NormedByDefinition(map, norm).detach()), 2e-6);
    const torch::NoGradGuard no_grad;
    EXPECT_LE(RelativeDifference(NormChannels(map, norm), NormedByDefinition(map, norm)), 2e-6) << channels;
    norm->to(torch::kBFloat16);
    const torch::Tensor half = map.to(torch::kBFloat16);
    ASSERT_EQ(NormChannels(half, norm).scalar_type(), torch::kBFloat16);
    EXPECT_LE(RelativeDifference(NormChannels(half, norm), NormedByDefinition(half, norm)), 4e-3) << channels;
  }
}

TEST(TokensTest, NormsAPixelOfEqualValuesToTheBias) {
  const torch::NoGradGuard no_grad;
  torch::nn::LayerNorm norm = RandomLayerNorm(24);
  const torch::Tensor map = torch::full({1, 24, 1, 2}, 7.5f).contiguous(torch::MemoryFormat::ChannelsLast);
  EXPECT_TRUE(torch::equal(NormChannels(map, norm), norm->bias.view({1, 24, 1, 1}).expand({1, 24, 1, 2})));
}

// All of what is more than rounding: from where the curve is 0 to where it is x, and more values than a register has.
TEST(TokensTest, GeluIsThatOfErf) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor x = torch::linspace(-9, 9, 40003).view({1, 1, 1, -1});
  const torch::Tensor want = torch::gelu(x.to(torch::kDouble));
  EXPECT_LE((Gelu(x.clone()).to(torch::kDouble) - want).abs().max().item<double>(), 5e-7);
  const torch::Tensor half = x.to(torch::kBFloat16);
  const torch::Tensor rounded = torch::gelu(half.to(torch::kDouble)).to(torch::kBFloat16);
  EXPECT_LE(RelativeDifference(Gelu(half.clone()), rounded), 4e-3);
  EXPECT_EQ(Gelu(torch::zeros({1, 3, 1, 1})).abs().max().item<float>(), 0.0f);
}

TEST(TokensTest, GeluHasAGradientAndLeavesItsInputThen) {
  const torch::Tensor x = TokenMap(8).requires_grad_();
  const torch::Tensor before = x.detach().clone();
  ExpectSameGradients([](const auto& in) { return Gelu(in[0]); }, [](const auto& in) { return torch::gelu(in[0]); },
                      {x.detach()}, 1e-5);
  Gelu(x);
  EXPECT_TRUE(torch::equal(x.detach(), before));
}

}  // namespace
}  // namespace holdfast
