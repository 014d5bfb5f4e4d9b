// SPDX-License-Identifier: Apache-2.0
#include "model/ops/convolution.h"

#include <ATen/Parallel.h>
#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <memory>

#include "model/kernels/convolution.h"
#include "model/kernels/instance_norm.h"
#include "model/kernels/simd.h"
#include "model/ops/instance_norm.h"

namespace holdfast {
namespace {

struct Geometry {
  std::array<int64_t, 2> stride = {1, 1};
  std::array<int64_t, 2> padding = {0, 0};
};

// What convolves maps.
struct Layer {
  torch::Tensor weight;  // [C', C, h, w]
  torch::Tensor bias;
  Geometry geometry;
  torch::Tensor packed;  // weight and bias as the kernel reads them; undefined: they have to be packed
};

Layer LayerOf(const torch::nn::Conv2d& conv) {
  const int64_t padding = conv->weight.size(2) / 2;
  return {conv->weight, conv->bias, {*conv->options.stride(), {padding, padding}}, {}};
}

Layer LayerOf(const Conv1dImpl& conv) {
  return {conv.weight.unsqueeze(2), conv.bias, {{1, 1}, {0, conv.weight.size(2) / 2}}, conv.packed()};
}
Layer LayerOf(const Conv1d& conv) { return LayerOf(*conv); }

// at::conv2d picks an implementation by the batch's size; asking for oneDNN by name keeps a map's result independent of
// its batch. bfloat16 without hardware support is left to conv2d, which knows what to do.
bool TakesOneDnn(const torch::Tensor& x) {
  return x.device().is_cpu() && x.scalar_type() == torch::kFloat32 && at::hasMKLDNN() && x.numel() > 0 &&
         !torch::GradMode::is_enabled();
}

// Without AVX-512 oneDNN convolves channels-last maps at a third to three quarters of what the processor can where
// there are many channels, or maps are large; our kernel comes close to it. Products of single pixels are fast in
// oneDNN too.
bool TakesKernel(const torch::Tensor& x, const torch::Tensor& weight) {
  return TakesOneDnn(x) && KernelInstructionSet() != InstructionSet::kAvx512 && weight.size(2) * weight.size(3) > 1;
}

// What the layer says of them.
ConvolutionMaps MapsOf(const Layer& layer) {
  ConvolutionMaps maps;
  maps.channels = layer.weight.size(1), maps.out_channels = layer.weight.size(0);
  maps.kernel_height = layer.weight.size(2), maps.kernel_width = layer.weight.size(3);
  maps.stride = layer.geometry.stride[0];
  return maps;
}

ConvolutionMaps MapsOf(const torch::Tensor& x, const Layer& layer) {
  const std::array<int64_t, 2>& padding = layer.geometry.padding;
  ConvolutionMaps maps = MapsOf(layer);
  maps.images = x.size(0), maps.height = x.size(2), maps.width = x.size(3);
  maps.out_height = (maps.height + 2 * padding[0] - maps.kernel_height) / maps.stride + 1;
  maps.out_width = (maps.width + 2 * padding[1] - maps.kernel_width) / maps.stride + 1;
  return maps;
}

// REQUIRES: float32 on the CPU.
torch::Tensor Pack(const Layer& layer) {
  const torch::Tensor weight = layer.weight.contiguous(torch::MemoryFormat::ChannelsLast);
  ConvolutionMaps maps = MapsOf(layer);
  const torch::Tensor packed = torch::empty({maps.packed_floats()}, torch::kFloat32);
  maps.weights = weight.data_ptr<float>();
  maps.bias = layer.bias.data_ptr<float>();
  maps.packed = packed.data_ptr<float>();
  PackWeights(maps);
  return packed;
}

torch::Tensor JoinMoments(const ConvolutionMaps& maps, const torch::Tensor& partial) {
  const torch::Tensor moments = torch::empty({maps.images, 2, maps.out_channels}, torch::kFloat32);
  const int64_t stride = 2 * maps.out_channels;
  for (int64_t n = 0; n < maps.images; ++n) {
    NormJoinMoments(partial.data_ptr<float>() + n * maps.out_height * stride,
                    {maps.out_height * maps.out_width, maps.out_width}, maps.out_channels,
                    moments.data_ptr<float>() + n * stride);
  }
  return moments;
}

// REQUIRES: TakesKernel. x is normed with its moments if there are any; 'measure' has those of the result taken.
MeasuredMap RunKernel(const MeasuredMap& x, const Layer& layer, bool measure) {
  const torch::Tensor input = x.map.contiguous(torch::MemoryFormat::ChannelsLast);
  ConvolutionMaps maps = MapsOf(input, layer);
  const auto options = input.options();
  MeasuredMap out;
  out.map = torch::empty({maps.images, maps.out_channels, maps.out_height, maps.out_width}, options,
                         torch::MemoryFormat::ChannelsLast);
  const torch::Tensor packed = layer.packed.defined() ? layer.packed : Pack(layer);
  const torch::Tensor partial = torch::empty({measure ? maps.rows() * 2 * maps.out_channels : 0}, options);
  maps.x = input.data_ptr<float>();
  maps.packed = packed.data_ptr<float>();
  maps.y = out.map.data_ptr<float>();
  if (x.moments.defined()) maps.moments = x.moments.data_ptr<float>();
  if (measure) maps.partial = partial.data_ptr<float>();
  at::parallel_for(0, maps.parts(), 1, [&](int64_t begin, int64_t end) {
    const std::unique_ptr<float[]> scratch(new float[static_cast<size_t>(maps.scratch_floats())]);
    ConvolveParts(maps, scratch.get(), begin, end);
  });
  if (measure) out.moments = JoinMoments(maps, partial);
  return out;
}

// oneDNN 3.6 (Debian 13) writes beyond its memory in the backward pass of such a convolution with several threads.
bool IsNarrowAndStrided(const torch::Tensor& x, const torch::Tensor& weight, const Geometry& geometry) {
  constexpr int64_t kNarrow = 16;
  return x.size(1) < kNarrow && weight.size(2) == 1 && weight.size(3) == 1 && geometry.stride[0] > 1;
}

torch::Tensor Run(const torch::Tensor& x, const Layer& layer) {
  const auto& [weight, bias, geometry, packed] = layer;
  if (TakesKernel(x, weight)) return RunKernel({x, {}}, layer, false).map;
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

MeasuredMap RunMeasured(const torch::Tensor& x, const Layer& layer) {
  if (TakesKernel(x, layer.weight)) return RunKernel({x, {}}, layer, true);
  return {Run(x, layer), {}};
}

// Whether the kernel norms x on the way.
bool NormsOnTheWay(const MeasuredMap& x, const Layer& layer) {
  return x.moments.defined() && TakesKernel(x.map, layer.weight);
}

MeasuredMap RunMeasured(const MeasuredMap& x, const Layer& layer) {
  return NormsOnTheWay(x, layer) ? RunKernel(x, layer, true) : RunMeasured(InstanceNormRelu(x), layer);
}

torch::Tensor AsKernel(const torch::Tensor& matrix) { return matrix.unsqueeze(2).unsqueeze(3); }

}  // namespace

Conv1dImpl::Conv1dImpl(const torch::nn::Conv1dOptions& options) : torch::nn::Conv1dImpl(options) {
  const torch::NoGradGuard no_grad;
  weight.set_data(weight.transpose(1, 2).contiguous().transpose(1, 2));
}

void Conv1dImpl::PackWeights() {
  const torch::NoGradGuard no_grad;
  packed_ = torch::Tensor();
  if (!TakesKernel(/*x=*/weight, weight.unsqueeze(2))) return;  // maps are where the weights are
  packed_ = Pack(LayerOf(*this));
  packed_of_ = stamp();
}

torch::Tensor Conv1dImpl::packed() const {
  return packed_.defined() && packed_of_ == stamp() ? packed_ : torch::Tensor();
}

void PackWeights(torch::nn::Module& network) {
  for (const std::shared_ptr<torch::nn::Module>& module : network.modules()) {
    if (auto* conv = module->as<Conv1dImpl>()) conv->PackWeights();
  }
}

torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv2d& conv) { return Run(x, LayerOf(conv)); }
torch::Tensor Convolve(const torch::Tensor& x, const Conv1d& conv) { return Run(x, LayerOf(conv)); }

torch::Tensor Convolve(const MeasuredMap& x, const Conv1d& conv) {
  const Layer layer = LayerOf(conv);
  return NormsOnTheWay(x, layer) ? RunKernel(x, layer, false).map : Run(InstanceNormRelu(x), layer);
}

MeasuredMap ConvolveMeasured(const torch::Tensor& x, const torch::nn::Conv2d& conv) {
  return RunMeasured(x, LayerOf(conv));
}
MeasuredMap ConvolveMeasured(const torch::Tensor& x, const Conv1d& conv) { return RunMeasured(x, LayerOf(conv)); }
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const torch::nn::Conv2d& conv) {
  return RunMeasured(x, LayerOf(conv));
}
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const Conv1d& conv) { return RunMeasured(x, LayerOf(conv)); }

torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Linear& linear) {
  return Run(x, {AsKernel(linear->weight), linear->bias, {}, {}});
}

torch::Tensor ConvolveInFloat(const torch::Tensor& x, const torch::nn::Linear& linear) {
  const auto wide = [](const torch::Tensor& tensor) { return tensor.to(torch::kFloat32); };
  return Run(wide(x), {AsKernel(wide(linear->weight)), wide(linear->bias), {}, {}});
}

void UseChannelsLast(torch::nn::Conv2d& conv) {
  const torch::NoGradGuard no_grad;
  conv->weight.set_data(conv->weight.contiguous(torch::MemoryFormat::ChannelsLast));
}

}  // namespace holdfast
