// SPDX-License-Identifier: Apache-2.0
#include "model/ops/convolution.h"

#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>
#include <torch/utils.h>

namespace holdfast {
namespace {

struct Geometry {
  std::array<int64_t, 2> stride = {1, 1};
  std::array<int64_t, 2> padding = {0, 0};
};

// at::conv2d picks an implementation by the batch's size; asking for oneDNN by name keeps a map's result independent of
// its batch. bfloat16 without hardware support is left to conv2d, which knows what to do.
bool TakesOneDnn(const torch::Tensor& x) {
  return x.device().is_cpu() && x.scalar_type() == torch::kFloat32 && at::hasMKLDNN() && x.numel() > 0 &&
         !torch::GradMode::is_enabled();
}

// oneDNN 3.6 (Debian 13) writes beyond its memory in the backward pass of such a convolution with several threads.
bool IsNarrowAndStrided(const torch::Tensor& x, const torch::Tensor& weight, const Geometry& geometry) {
  constexpr int64_t kNarrow = 16;
  return x.size(1) < kNarrow && weight.size(2) == 1 && weight.size(3) == 1 && geometry.stride[0] > 1;
}

torch::Tensor Run(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias,
                  const Geometry& geometry) {
  if (TakesOneDnn(x)) {
    return at::mkldnn_convolution(x, weight, bias, geometry.padding, geometry.stride, {1, 1}, 1);
  }
  if (IsNarrowAndStrided(x, weight, geometry)) {
    const auto [down, across] = geometry.stride;
    const torch::Tensor pixels = x.slice(2, 0, x.size(2), down).slice(3, 0, x.size(3), across);
    return at::conv2d(pixels.contiguous(torch::MemoryFormat::ChannelsLast), weight, bias);
  }
  return at::conv2d(x, weight, bias, geometry.stride, geometry.padding);
}

torch::Tensor AsKernel(const torch::Tensor& matrix) { return matrix.unsqueeze(2).unsqueeze(3); }

}  // namespace

torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv2d& conv) {
  const int64_t padding = conv->weight.size(2) / 2;
  return Run(x, conv->weight, conv->bias, {*conv->options.stride(), {padding, padding}});
}

torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv1d& conv) {
  const int64_t kernel = conv->weight.size(2);
  return Run(x, conv->weight.unsqueeze(2), conv->bias, {{1, 1}, {0, kernel / 2}});
}

torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Linear& linear) {
  return Run(x, AsKernel(linear->weight), linear->bias, {});
}

torch::Tensor ConvolveInFloat(const torch::Tensor& x, const torch::nn::Linear& linear) {
  const auto wide = [](const torch::Tensor& tensor) { return tensor.to(torch::kFloat32); };
  return Run(wide(x), AsKernel(wide(linear->weight)), wide(linear->bias), {});
}

void UseChannelsLast(torch::nn::Conv2d& conv) {
  const torch::NoGradGuard no_grad;
  conv->weight.set_data(conv->weight.contiguous(torch::MemoryFormat::ChannelsLast));
}

void UseChannelsLast(torch::nn::Conv1d& conv) {
  const torch::NoGradGuard no_grad;
  conv->weight.set_data(conv->weight.transpose(1, 2).contiguous().transpose(1, 2));
}

}  // namespace holdfast
