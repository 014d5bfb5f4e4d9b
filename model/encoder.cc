// SPDX-License-Identifier: Apache-2.0
#include "model/encoder.h"

#include <torch/nn/init.h>
#include <torch/nn/modules/container/sequential.h>
#include <torch/nn/modules/conv.h>
#include <torch/types.h>

#include "model/ops/convolution.h"
#include "model/ops/instance_norm.h"
#include "model/ops/resize.h"

namespace holdfast {
namespace {

torch::nn::Conv2d MakeConv(int64_t in_channels, int64_t out_channels, int64_t kernel, int64_t stride = 1) {
  torch::nn::Conv2d conv(
      torch::nn::Conv2dOptions(in_channels, out_channels, kernel).stride(stride).padding(kernel / 2));
  torch::nn::init::kaiming_normal_(conv->weight, 0, torch::kFanOut, torch::kReLU);
  UseChannelsLast(conv);
  return conv;
}

}  // namespace

EncoderBlockImpl::EncoderBlockImpl(int64_t in_channels, int64_t out_channels, int64_t stride)
    : conv1_(register_module("conv1", MakeConv(in_channels, out_channels, 3, stride))),
      conv2_(register_module("conv2", MakeConv(out_channels, out_channels, 3))) {
  if (stride == 1) return;
  shortcut_ = MakeConv(in_channels, out_channels, 1, stride);
  register_module("downsample", torch::nn::Sequential(shortcut_));
}

torch::Tensor EncoderBlockImpl::forward(const torch::Tensor& x) {
  const MeasuredMap y = ConvolveMeasured(ConvolveMeasured(x, conv1_), conv2_);
  return InstanceNormReluAdd(y, shortcut_.is_empty() ? x : InstanceNorm(Convolve(x, shortcut_)));
}

EncoderImpl::EncoderImpl(const ModelOptions& options) {
  const auto& channels = options.encoder_channels;
  conv1_ = register_module("conv1", MakeConv(3, channels[0], 7, 2));
  int64_t in_channels = channels[0];
  int64_t stacked = 0;
  for (size_t i = 0; i < channels.size(); ++i) {
    torch::nn::Sequential layer(EncoderBlock(in_channels, channels[i], i == 0 ? 1 : 2),
                                EncoderBlock(channels[i], channels[i], 1));
    layers_.push_back(register_module("layer" + std::to_string(i + 1), layer));
    in_channels = channels[i];
    stacked += channels[i];
  }
  conv2_ = register_module("conv2", MakeConv(stacked, options.encoder_mid, 3));
  conv3_ = register_module("conv3", MakeConv(options.encoder_mid, options.feature_channels, 1));
}

torch::Tensor EncoderImpl::forward(const torch::Tensor& x) {
  const int64_t height = x.size(2) / 8;
  const int64_t width = x.size(3) / 8;
  torch::Tensor map = InstanceNormRelu(ConvolveMeasured(x, conv1_));
  std::vector<torch::Tensor> scales;
  for (auto& layer : layers_) {
    map = layer->forward(map);
    scales.push_back(map);
  }
  const MeasuredMap joined = ConvolveMeasured(ResizeAndJoin(scales, height, width), conv2_);
  return Convolve(InstanceNormRelu(joined), conv3_);
}

}  // namespace holdfast
