// SPDX-License-Identifier: Apache-2.0
#include "model/ops/convolution.h"

#include <ATen/Parallel.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <memory>

#include "model/kernels/convolution.h"
#include "model/kernels/simd.h"

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

// Without AVX-512 oneDNN convolves channels-last maps at a third to three quarters of what the processor can where
// there are many channels, or maps are large; our kernel comes close to it. Products of single pixels are fast in
// oneDNN too.
bool TakesKernel(const torch::Tensor& weight) {
  return KernelInstructionSet() != InstructionSet::kAvx512 && weight.size(2) * weight.size(3) > 1;
}

// x and weight float32, of at least one pixel.
torch::Tensor RunKernel(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias,
                        const Geometry& geometry) {
  const torch::Tensor input = x.contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor weights = weight.contiguous(torch::MemoryFormat::ChannelsLast);
  ConvolutionMaps maps;
  maps.images = x.size(0), maps.channels = x.size(1), maps.height = x.size(2), maps.width = x.size(3);
  maps.kernel_height = weight.size(2), maps.kernel_width = weight.size(3);
  maps.stride = geometry.stride[0];
  maps.out_channels = weight.size(0);
  maps.out_height = (maps.height + 2 * geometry.padding[0] - maps.kernel_height) / maps.stride + 1;
  maps.out_width = (maps.width + 2 * geometry.padding[1] - maps.kernel_width) / maps.stride + 1;
  const torch::Tensor out = torch::empty({maps.images, maps.out_channels, maps.out_height, maps.out_width}, x.options(),
                                         torch::MemoryFormat::ChannelsLast);
  const torch::Tensor packed = torch::empty({maps.packed_floats()}, x.options());
  maps.x = input.data_ptr<float>();
  maps.weights = weights.data_ptr<float>();
  maps.bias = bias.data_ptr<float>();
  maps.packed = packed.data_ptr<float>();
  maps.y = out.data_ptr<float>();
  PackWeights(maps);
  at::parallel_for(0, maps.rows(), 1, [&](int64_t begin, int64_t end) {
    const std::unique_ptr<float[]> scratch(new float[static_cast<size_t>(maps.scratch_floats())]);
    ConvolveRows(maps, scratch.get(), begin, end);
  });
  return out;
}

// oneDNN 3.6 (Debian 13) writes beyond its memory in the backward pass of such a convolution with several threads.
bool IsNarrowAndStrided(const torch::Tensor& x, const torch::Tensor& weight, const Geometry& geometry) {
  constexpr int64_t kNarrow = 16;
  return x.size(1) < kNarrow && weight.size(2) == 1 && weight.size(3) == 1 && geometry.stride[0] > 1;
}

torch::Tensor Run(const torch::Tensor& x, const torch::Tensor& weight, const torch::Tensor& bias,
                  const Geometry& geometry) {
  if (TakesOneDnn(x)) {
    if (TakesKernel(weight)) return RunKernel(x, weight, bias, geometry);
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
