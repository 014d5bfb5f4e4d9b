// SPDX-License-Identifier: Apache-2.0
// The residual network `fnet`: a picture to features at an eighth of its size.
#pragma once

#include <torch/nn/modules/container/sequential.h>
#include <torch/nn/modules/conv.h>
#include <torch/types.h>

#include <vector>

#include "model/options.h"

namespace holdfast {

// relu(identity + relu(norm(conv2(relu(norm(conv1 x)))))); the identity goes through a normed 1x1 convolution when the
// stride is not 1.
class EncoderBlockImpl : public torch::nn::Module {
 public:
  EncoderBlockImpl(int64_t in_channels, int64_t out_channels, int64_t stride);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  torch::nn::Conv2d conv1_{nullptr};
  torch::nn::Conv2d conv2_{nullptr};
  torch::nn::Conv2d shortcut_{nullptr};  // `downsample.0`; null when the stride is 1
};
TORCH_MODULE(EncoderBlock);

class EncoderImpl : public torch::nn::Module {
 public:
  explicit EncoderImpl(const ModelOptions& options);
  // x [F, 3, H, W] in [-1, 1], channels-last -> [F, C, H/8, W/8] channels-last.
  torch::Tensor forward(const torch::Tensor& x);

 private:
  torch::nn::Conv2d conv1_{nullptr};
  std::vector<torch::nn::Sequential> layers_;  // layer1 .. layer4, two blocks each
  torch::nn::Conv2d conv2_{nullptr};
  torch::nn::Conv2d conv3_{nullptr};
};
TORCH_MODULE(Encoder);

}  // namespace holdfast
