// SPDX-License-Identifier: Apache-2.0
#include "model/ops/patch_attention.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <utility>
#include <vector>

#include "model/contextual_attention.h"
#include "tests/support/gradient_check.h"

namespace holdfast {
namespace {

constexpr AttentionShape kShape{2, 7};

struct Maps {
  torch::Tensor query;  // [F, H, W, C]
  torch::Tensor value;
};

Maps RandomMaps(int64_t height, int64_t width, int64_t channels = 12) {
  torch::manual_seed(17);
  return {torch::randn({2, height, width, channels}) * 2, torch::randn({2, height, width, channels})};
}

// From the definition, differentiable and in whatever precision the maps have: all tokens of a frame at once, of which
// those that are no neighbours are masked.
torch::Tensor Definition(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape) {
  const int64_t height = query.size(1), width = query.size(2), depth = query.size(3) / shape.heads;
  std::vector<int64_t> neighbours;
  for (int64_t a = 0; a < height * width; ++a) {
    for (int64_t b = 0; b < height * width; ++b) {
      const int64_t down = a / width / shape.patch - b / width / shape.patch;
      const int64_t right = a % width / shape.patch - b % width / shape.patch;
      neighbours.push_back(std::abs(down) <= 1 && std::abs(right) <= 1);
    }
  }
  const torch::Tensor mask = torch::tensor(neighbours).view({height * width, height * width}) == 0;
  const auto split = [&](const torch::Tensor& map) { return map.flatten(1, 2).unflatten(2, {shape.heads, depth}); };
  const torch::Tensor scores =
      torch::einsum("fqhc,fkhc->fhqk", {split(query), split(value)}) / std::sqrt(static_cast<double>(depth));
  const torch::Tensor weights = torch::softmax(scores.masked_fill(mask, -1e30), 3);
  return torch::einsum("fhqk,fkhc->fqhc", {weights, split(value)}).reshape(query.sizes());
}

const TensorFunction kFused = [](const auto& in) { return PatchAttention(in[0], in[1], kShape); };
const TensorFunction kPlain = [](const auto& in) { return PatchAttentionPlain(in[0], in[1], kShape); };
const TensorFunction kDefinition = [](const auto& in) { return Definition(in[0], in[1], kShape); };

// By hand: patches of one token in a row of three. The middle one sees all of them, the outer ones two.
TEST(PatchAttentionTest, ThreeTokensByHand) {
  const torch::Tensor query = torch::tensor({0.0f, std::log(2.0f), 0.0f}).view({1, 1, 3, 1});
  const torch::Tensor value = torch::tensor({1.0f, 2.0f, 6.0f}).view({1, 1, 3, 1});
  const double middle = (2 * 1 + 4 * 2 + 64 * 6) / 70.0;  // weights 2^1, 2^2 and 2^6
  const torch::Tensor want = torch::tensor({1.5, middle, 4.0}).view({1, 1, 3, 1});
  EXPECT_LE(RelativeDifference(PatchAttention(query, value, {1, 1}), want), 1e-6);
  EXPECT_LE(RelativeDifference(PatchAttentionPlain(query, value, {1, 1}), want), 1e-6);
  EXPECT_LE(RelativeDifference(Definition(query, value, {1, 1}), want), 1e-6);
}

TEST(PatchAttentionTest, TokensOutsideTheMapTakeNoPart) {
  for (const auto& [height, width] : {std::pair<int64_t, int64_t>{14, 21}, {9, 16}, {3, 5}, {22, 8}}) {
    const Maps maps = RandomMaps(height, width);
    const torch::Tensor want = Definition(maps.query.to(torch::kDouble), maps.value.to(torch::kDouble), kShape);
    EXPECT_LE(RelativeDifference(PatchAttention(maps.query, maps.value, kShape), want), 1e-5);
    EXPECT_LE(RelativeDifference(PatchAttentionPlain(maps.query, maps.value, kShape), want), 1e-5);
  }
}

TEST(PatchAttentionTest, GradientsEqualThoseOfTheDefinition) {
  for (const auto& [height, width] : {std::pair<int64_t, int64_t>{16, 9}, {7, 22}}) {
    const Maps maps = RandomMaps(height, width);
    ExpectSameGradients(kFused, kDefinition, {maps.query, maps.value}, 2e-5);
    ExpectSameGradients(kPlain, kDefinition, {maps.query, maps.value}, 2e-5);
  }
}

TEST(PatchAttentionTest, HalfPrecisionIsCloseToFull) {
  const Maps maps = RandomMaps(10, 15, 32);
  ExpectSameGradients(kFused, kDefinition, {maps.query, maps.value}, 2e-2, torch::kBFloat16);
}

TEST(PatchAttentionTest, LargeScoresDoNotOverflow) {
  Maps maps = RandomMaps(8, 8);
  maps.query.mul_(300);
  const torch::Tensor want = Definition(maps.query.to(torch::kDouble), maps.value.to(torch::kDouble), kShape);
  EXPECT_LE(RelativeDifference(PatchAttention(maps.query, maps.value, kShape), want), 1e-4);
}

TEST(PatchAttentionTest, WhatIsNotANumberInAQueryComesOut) {
  Maps maps = RandomMaps(8, 8);
  maps.query[0][2][3] = std::numeric_limits<float>::quiet_NaN();
  const torch::Tensor out = PatchAttention(maps.query, maps.value, kShape).isnan();
  EXPECT_TRUE(out[0][2][3].all().item<bool>());
  EXPECT_EQ(out.sum().item<int64_t>(), out[0][2][3].numel()) << "others do not see it";
}

TEST(ContextualAttentionTest, FramesDoNotSeeEachOther) {
  const c10::InferenceMode guard;
  ModelOptions options;
  options.feature_channels = 16;
  options.context_blocks = 2;
  options.context_heads = 4;
  ContextualAttention context(options);
  const torch::Tensor maps = torch::randn({3, 16, 9, 10}).contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor together = context->forward(maps);
  EXPECT_TRUE(torch::equal(context->forward(maps.narrow(0, 1, 1)), together.narrow(0, 1, 1)));
}

}  // namespace
}  // namespace holdfast
