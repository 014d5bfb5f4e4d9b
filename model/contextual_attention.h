// SPDX-License-Identifier: Apache-2.0
// The module `context`: features of a frame look at their surroundings. The map is cut into M x M patches; the tokens
// of a patch attend to those of its 3 x 3 neighbour patches. Tokens outside the map do not exist.
#pragma once

#include <torch/nn/modules/container/modulelist.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>

#include "model/options.h"

namespace holdfast {

class AttentionMlpImpl : public torch::nn::Module {
 public:
  AttentionMlpImpl(int64_t channels, int64_t hidden);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  torch::nn::Linear fc1_{nullptr};
  torch::nn::Linear fc2_{nullptr};
};
TORCH_MODULE(AttentionMlp);

// x + proj(attention(norm1 x)), then x + mlp(norm2 x). Keys and values share one projection.
class ContextBlockImpl : public torch::nn::Module {
 public:
  explicit ContextBlockImpl(const ModelOptions& options);
  // x [F, C, H8, W8] channels-last -> the same.
  torch::Tensor forward(const torch::Tensor& x);

 private:
  int64_t heads_;
  int64_t patch_;
  torch::nn::LayerNorm norm1_{nullptr};
  torch::nn::Linear query_{nullptr};
  torch::nn::Linear value_{nullptr};
  torch::nn::Linear proj_{nullptr};
  torch::nn::LayerNorm norm2_{nullptr};
  AttentionMlp mlp_{nullptr};
};
TORCH_MODULE(ContextBlock);

class ContextualAttentionImpl : public torch::nn::Module {
 public:
  explicit ContextualAttentionImpl(const ModelOptions& options);
  // map [F, C, H8, W8] channels-last -> the same; frames do not see each other.
  torch::Tensor forward(const torch::Tensor& map);

 private:
  torch::nn::ModuleList blocks_{nullptr};
  torch::nn::LayerNorm norm_{nullptr};
};
TORCH_MODULE(ContextualAttention);

}  // namespace holdfast
