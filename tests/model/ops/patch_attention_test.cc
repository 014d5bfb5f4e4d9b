// SPDX-License-Identifier: Apache-2.0
#include "model/ops/patch_attention.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

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

// Token by token, from the definition.
torch::Tensor TokenByToken(const Maps& maps, const AttentionShape& shape) {
  const int64_t m = shape.patch;
  const int64_t depth = maps.query.size(3) / shape.heads;
  torch::Tensor out = torch::zeros_like(maps.query);
  for (int64_t y = 0; y < maps.query.size(1); ++y) {
    for (int64_t x = 0; x < maps.query.size(2); ++x) {
      const int64_t top = std::max<int64_t>(0, (y / m - 1) * m);
      const int64_t left = std::max<int64_t>(0, (x / m - 1) * m);
      const int64_t bottom = std::min(maps.query.size(1), (y / m + 2) * m);
      const int64_t right = std::min(maps.query.size(2), (x / m + 2) * m);
      for (int64_t h = 0; h < shape.heads; ++h) {
        const torch::Tensor q = maps.query.select(1, y).select(1, x).narrow(1, h * depth, depth);
        const torch::Tensor keys = maps.value.narrow(1, top, bottom - top)
                                       .narrow(2, left, right - left)
                                       .narrow(3, h * depth, depth)
                                       .flatten(1, 2);
        const torch::Tensor weights = torch::softmax(torch::einsum("fc,fkc->fk", {q, keys}) / std::sqrt(depth), 1);
        out.select(1, y).select(1, x).narrow(1, h * depth, depth).copy_(torch::einsum("fk,fkc->fc", {weights, keys}));
      }
    }
  }
  return out;
}

TEST(PatchAttentionTest, TokensOutsideTheMapTakeNoPart) {
  for (const auto& [height, width] : {std::pair<int64_t, int64_t>{14, 21}, {9, 16}, {3, 5}, {22, 8}}) {
    const Maps maps = RandomMaps(height, width);
    const torch::Tensor want = TokenByToken(maps, kShape);
    EXPECT_LE(RelativeDifference(PatchAttention(maps.query, maps.value, kShape), want), 1e-5);
    EXPECT_LE(RelativeDifference(PatchAttentionPlain(maps.query, maps.value, kShape), want), 1e-5);
  }
}

TEST(PatchAttentionTest, GradientsEqualThoseOfThePlainWay) {
  const Maps maps = RandomMaps(16, 9);
  const auto fused = [](const std::vector<torch::Tensor>& in) { return PatchAttention(in[0], in[1], kShape); };
  ExpectSameGradients(fused, fused, {maps.query, maps.value}, 2e-5);  // double takes the plain way
  const Maps small = RandomMaps(4, 3, 4);
  ExpectDifferentiable([](const auto& in) { return PatchAttention(in[0], in[1], {2, 2}); }, {small.query, small.value});
}

TEST(PatchAttentionTest, HalfPrecisionIsCloseToFull) {
  const Maps maps = RandomMaps(10, 15, 32);
  const auto fused = [](const std::vector<torch::Tensor>& in) { return PatchAttention(in[0], in[1], kShape); };
  ExpectSameGradients(fused, fused, {maps.query, maps.value}, 2e-2, torch::kBFloat16);
}

TEST(PatchAttentionTest, LargeScoresDoNotOverflow) {
  Maps maps = RandomMaps(8, 8);
  maps.query.mul_(300);
  const torch::Tensor got = PatchAttention(maps.query, maps.value, kShape);
  EXPECT_LE(RelativeDifference(got, TokenByToken(maps, kShape)), 1e-4);
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
