// SPDX-License-Identifier: Apache-2.0
// The module `delta_block`: a residual network over time that turns correlations and motion into a step for each frame.
#pragma once

#include <torch/nn/modules/container/modulelist.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>

#include "model/ops/convolution.h"
#include "model/options.h"

namespace holdfast {

// Kernel 3 over time, zeros beyond the window's ends. The parameter is `conv`.
class TemporalConvImpl : public torch::nn::Module {
 public:
  TemporalConvImpl(int64_t in_channels, int64_t out_channels);
  // x [N, C, 1, S] channels-last -> [N, C', 1, S] channels-last.
  torch::Tensor forward(const torch::Tensor& x);
  const Conv1d& conv() const { return conv_; }

 private:
  Conv1d conv_{nullptr};
};
TORCH_MODULE(TemporalConv);

// x + conv2(relu(norm(conv1(relu(norm x))))); the first block of the stack has no leading norm and ReLU. When channels
// grow, zeros are added to x on both sides of the channel axis.
class TemporalBlockImpl : public torch::nn::Module {
 public:
  TemporalBlockImpl(int64_t in_channels, int64_t out_channels, bool first);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  int64_t growth_;
  bool first_;
  TemporalConv conv1_{nullptr};
  TemporalConv conv2_{nullptr};
};
TORCH_MODULE(TemporalBlock);

class UpdateBlockImpl : public torch::nn::Module {
 public:
  explicit UpdateBlockImpl(const ModelOptions& options);
  // correlation [N, S, 3 * L * (2R+1)^2] float32 (template-major), xy [N, S, 2] float32 feature pixels -> [N, S, 2] or,
  // with a visibility head, [N, S, 3] float32: the step in feature pixels and the visibility logit. A row's result does
  // not depend on the other rows.
  torch::Tensor forward(const torch::Tensor& correlation, const torch::Tensor& xy);

 private:
  int64_t embedding_channels_;
  TemporalConv first_block_conv_{nullptr};
  torch::nn::ModuleList basicblock_list_{nullptr};
  torch::nn::Linear dense_{nullptr};
};
TORCH_MODULE(UpdateBlock);

// xy [N, S, 2] float32 -> [N, S, channels + 2] float32: sines and cosines of the motion to the next frame (the last one
// repeated), then the motion itself.
torch::Tensor EmbedMotion(const torch::Tensor& xy, int64_t channels);

}  // namespace holdfast
