// SPDX-License-Identifier: Apache-2.0
#include "model/update_block.h"

#include <torch/nn/modules/container/modulelist.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>

#include <algorithm>
#include <cmath>

#include "model/ops/convolution.h"
#include "model/ops/instance_norm.h"

namespace holdfast {
namespace {

constexpr int64_t kBlocks = 8;
constexpr int64_t kBlocksPerStage = 2;  // channels double from one stage to the next

}  // namespace

TemporalConvImpl::TemporalConvImpl(int64_t in_channels, int64_t out_channels)
    : conv_(register_module("conv", Conv1d(torch::nn::Conv1dOptions(in_channels, out_channels, 3)))) {}

torch::Tensor TemporalConvImpl::forward(const torch::Tensor& x) { return Convolve(x, conv_); }

TemporalBlockImpl::TemporalBlockImpl(int64_t in_channels, int64_t out_channels, bool first)
    : growth_(out_channels - in_channels),
      first_(first),
      conv1_(register_module("conv1", TemporalConv(in_channels, out_channels))),
      conv2_(register_module("conv2", TemporalConv(out_channels, out_channels))) {}

torch::Tensor TemporalBlockImpl::forward(const torch::Tensor& x) {
  const MeasuredMap y = first_ ? ConvolveMeasured(x, conv1_->conv()) : ConvolveMeasured(Measure(x), conv1_->conv());
  torch::Tensor sum = Convolve(y, conv2_->conv());
  sum.narrow(1, growth_ / 2, x.size(1)).add_(x);
  return sum;
}

UpdateBlockImpl::UpdateBlockImpl(const ModelOptions& options) : embedding_channels_(options.feature_channels) {
  const int64_t base = options.update_base;
  const int64_t inputs = options.CorrelationFeatures() + options.feature_channels + 2;
  first_block_conv_ = register_module("first_block_conv", TemporalConv(inputs, base));
  torch::nn::ModuleList blocks;
  int64_t channels = base;
  for (int64_t i = 0; i < kBlocks; ++i) {
    const int64_t out_channels = base << (i / kBlocksPerStage);
    blocks->push_back(TemporalBlock(channels, out_channels, i == 0));
    channels = out_channels;
  }
  basicblock_list_ = register_module("basicblock_list", blocks);
  dense_ = register_module("dense", torch::nn::Linear(channels, options.visibility_head ? 3 : 2));
}

torch::Tensor UpdateBlockImpl::forward(const torch::Tensor& correlation, const torch::Tensor& xy) {
  const torch::Tensor inputs = torch::cat({correlation, EmbedMotion(xy, embedding_channels_)}, 2);
  // [N, D, 1, S] channels-last
  torch::Tensor x = inputs.to(dense_->weight.scalar_type()).unsqueeze(1).permute({0, 3, 1, 2});
  x = first_block_conv_->forward(x).relu_();
  for (const auto& block : *basicblock_list_) x = block->as<TemporalBlock>()->forward(x);
  return ConvolveInFloat(torch::relu(x), dense_).squeeze(2).transpose(1, 2).to(torch::kFloat32);
}

torch::Tensor EmbedMotion(const torch::Tensor& xy, int64_t channels) {
  const int64_t frames = xy.size(1);
  const torch::Tensor steps = xy.narrow(1, 1, frames - 1) - xy.narrow(1, 0, frames - 1);
  const torch::Tensor motion = torch::cat({steps, steps.narrow(1, frames - 2, 1)}, 1);
  const int64_t bands = channels / 4;
  const double last = static_cast<double>(std::max<int64_t>(1, bands - 1));
  const torch::Tensor omega = torch::pow(10000.0, torch::arange(bands, xy.options()) / -last);
  const torch::Tensor x = motion.narrow(2, 0, 1) * omega;
  const torch::Tensor y = motion.narrow(2, 1, 1) * omega;
  return torch::cat({x.sin(), x.cos(), y.sin(), y.cos(), motion}, 2);
}

}  // namespace holdfast
