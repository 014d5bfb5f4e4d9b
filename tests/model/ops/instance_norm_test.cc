// SPDX-License-Identifier: Apache-2.0
#include "model/ops/instance_norm.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <limits>

#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

// Values far from zero: where sums of squares would cancel.
torch::Tensor Map(torch::IntArrayRef shape) {
  torch::manual_seed(5);
  return (torch::randn(shape) + 3).contiguous(torch::MemoryFormat::ChannelsLast);
}

torch::Tensor PlainNorm(const torch::Tensor& x) {
  return torch::instance_norm(x, {}, {}, {}, {}, /*use_input_stats=*/true, 0.1, 1e-5, false);
}

TEST(InstanceNormTest, EqualsTheFormulaWithGradients) {
  for (const auto& shape : {std::vector<int64_t>{2, 24, 19, 23}, {3, 5, 1, 24}, {1, 64, 2, 4}}) {
    const torch::Tensor x = Map(shape);
    const torch::Tensor identity = torch::randn(shape);
    ExpectSameGradients([](const auto& in) { return InstanceNorm(in[0]); },
                        [](const auto& in) { return PlainNorm(in[0]); }, {x}, 2e-5);
    ExpectSameGradients([](const auto& in) { return InstanceNormRelu(in[0]); },
                        [](const auto& in) { return torch::relu(PlainNorm(in[0])); }, {x}, 2e-5);
    ExpectSameGradients([](const auto& in) { return InstanceNormReluAdd(in[0], in[1]); },
                        [](const auto& in) { return torch::relu(in[1] + torch::relu(PlainNorm(in[0]))); },
                        {x, identity}, 2e-5);
  }
}

TEST(InstanceNormTest, HalfPrecisionStorageKeepsFullPrecisionStatistics) {
  const torch::Tensor x = Map({2, 32, 40, 30});
  const torch::Tensor identity = torch::randn({2, 32, 40, 30});
  ExpectSameGradients([](const auto& in) { return InstanceNormReluAdd(in[0], in[1]); },
                      [](const auto& in) { return torch::relu(in[1] + torch::relu(PlainNorm(in[0]))); }, {x, identity},
                      2e-2, torch::kBFloat16);
  const torch::Tensor half = x.to(torch::kBFloat16);
  const torch::Tensor y = InstanceNorm(half);
  EXPECT_EQ(y.scalar_type(), torch::kBFloat16);
  EXPECT_LE((y.to(torch::kFloat32) - PlainNorm(half.to(torch::kFloat32))).abs().max().item<float>(), 0.02f);
}

TEST(InstanceNormTest, FallbackOfOtherDevicesIsDifferentiable) {
  ExpectDifferentiable([](const auto& in) { return InstanceNormReluAdd(in[0], in[1]); },
                       {Map({1, 3, 4, 5}), torch::randn({1, 3, 4, 5})});
}

TEST(InstanceNormTest, ResultDependsNeitherOnBatchNorOnThreads) {
  const torch::Tensor x = Map({5, 48, 33, 31});
  const int threads = torch::get_num_threads();
  torch::set_num_threads(1);
  const torch::Tensor alone = InstanceNormRelu(x.narrow(0, 3, 1));
  torch::set_num_threads(2);
  const torch::Tensor together = InstanceNormRelu(x);
  torch::set_num_threads(threads);
  EXPECT_TRUE(torch::equal(alone, together.narrow(0, 3, 1)));
}

// In registers and in what is left beside them.
TEST(InstanceNormTest, WhatIsNotANumberStaysInItsChannelAndComesOut) {
  const torch::Tensor x = Map({1, 19, 5, 7});
  for (const int64_t channel : {0, 18}) {
    torch::Tensor wrong = x.clone(torch::MemoryFormat::ChannelsLast);
    wrong[0][channel][2][3] = std::numeric_limits<float>::quiet_NaN();
    for (const torch::ScalarType dtype : {torch::kFloat32, torch::kBFloat16}) {
      const torch::Tensor y = InstanceNormReluAdd(wrong.to(dtype), x.to(dtype));
      EXPECT_TRUE(torch::equal(y.isnan().flatten(2).all(2).nonzero(), torch::tensor({{int64_t{0}, channel}})));
      EXPECT_EQ(InstanceNormRelu(wrong.to(dtype)).isnan().sum().item<int64_t>(), 5 * 7);
    }
  }
}

TEST(InstanceNormTest, ChannelsLastStays) {
  const torch::Tensor y = InstanceNormRelu(torch::randn({2, 6, 5, 4}));
  EXPECT_TRUE(y.is_contiguous(torch::MemoryFormat::ChannelsLast));
}

}  // namespace
}  // namespace holdfast
