// SPDX-License-Identifier: Apache-2.0
#include "model/contextual_attention.h"

#include <torch/nn/modules/container/modulelist.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>

#include "model/ops/convolution.h"
#include "model/ops/patch_attention.h"
#include "model/ops/tokens.h"

namespace holdfast {
namespace {

// [F, C, H, W] channels-last <-> [F, H, W, C] contiguous: views of the same memory.
torch::Tensor ToTokens(const torch::Tensor& map) { return map.permute({0, 2, 3, 1}); }
torch::Tensor ToMap(const torch::Tensor& tokens) { return tokens.permute({0, 3, 1, 2}); }

torch::nn::LayerNorm MakeNorm(int64_t channels) {
  return torch::nn::LayerNorm(torch::nn::LayerNormOptions({channels}).eps(1e-5));
}

}  // namespace

AttentionMlpImpl::AttentionMlpImpl(int64_t channels, int64_t hidden)
    : fc1_(register_module("fc1", torch::nn::Linear(channels, hidden))),
      fc2_(register_module("fc2", torch::nn::Linear(hidden, channels))) {}

torch::Tensor AttentionMlpImpl::forward(const torch::Tensor& x) { return Convolve(Gelu(Convolve(x, fc1_)), fc2_); }

ContextBlockImpl::ContextBlockImpl(const ModelOptions& options)
    : heads_(options.context_heads), patch_(options.context_patch) {
  const int64_t channels = options.feature_channels;
  norm1_ = register_module("norm1", MakeNorm(channels));
  query_ = register_module("query", torch::nn::Linear(channels, channels));
  value_ = register_module("value", torch::nn::Linear(channels, channels));
  proj_ = register_module("proj", torch::nn::Linear(channels, channels));
  norm2_ = register_module("norm2", MakeNorm(channels));
  mlp_ = register_module("mlp", AttentionMlp(channels, channels * options.context_mlp_ratio));
}

torch::Tensor ContextBlockImpl::forward(const torch::Tensor& x) {
  const torch::Tensor normed = NormChannels(x, norm1_);
  const torch::Tensor query = ToTokens(Convolve(normed, query_));
  const torch::Tensor value = ToTokens(Convolve(normed, value_));
  const torch::Tensor attended = ToMap(PatchAttention(query, value, {heads_, patch_}));
  const torch::Tensor y = Convolve(attended, proj_).add_(x);
  return mlp_->forward(NormChannels(y, norm2_)).add_(y);
}

ContextualAttentionImpl::ContextualAttentionImpl(const ModelOptions& options) {
  torch::nn::ModuleList blocks;
  for (int64_t i = 0; i < options.context_blocks; ++i) blocks->push_back(ContextBlock(options));
  blocks_ = register_module("blocks", blocks);
  norm_ = register_module("norm", MakeNorm(options.feature_channels));
}

torch::Tensor ContextualAttentionImpl::forward(const torch::Tensor& map) {
  torch::Tensor x = map;
  for (const auto& block : *blocks_) x = block->as<ContextBlock>()->forward(x);
  return NormChannels(x, norm_);
}

}  // namespace holdfast
