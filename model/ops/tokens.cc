// SPDX-License-Identifier: Apache-2.0
#include "model/ops/tokens.h"

#include <ATen/Parallel.h>
#include <torch/nn/modules/normalization.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "model/kernels/tokens.h"
#include "model/ops/kernel_type.h"

namespace holdfast {
namespace {

constexpr int64_t kGrainValues = 32768;

template <typename T>
void NormInto(const torch::Tensor& map, const torch::nn::LayerNorm& norm, const torch::Tensor& out) {
  const torch::Tensor weight = norm->weight.to(torch::kFloat32);
  const torch::Tensor bias = norm->bias.to(torch::kFloat32);
  NormedTokens<T> tokens;
  tokens.channels = map.size(1);
  tokens.epsilon = static_cast<float>(norm->options.eps());
  tokens.weight = weight.data_ptr<float>();
  tokens.bias = bias.data_ptr<float>();
  tokens.x = KernelData<T>(map);
  tokens.y = KernelData<T>(out);
  at::parallel_for(0, map.numel() / tokens.channels, std::max<int64_t>(1, kGrainValues / tokens.channels),
                   [&](int64_t begin, int64_t end) { NormTokens(tokens, begin, end); });
}

torch::Tensor NormPlain(const torch::Tensor& map, const torch::nn::LayerNorm& norm) {
  const torch::ScalarType dtype = norm->weight.scalar_type();
  const torch::ScalarType wide = torch::promote_types(dtype, torch::kFloat32);
  const torch::Tensor tokens = map.permute({0, 2, 3, 1}).contiguous().to(wide);
  const auto& options = norm->options;
  const torch::Tensor normed =
      torch::layer_norm(tokens, options.normalized_shape(), norm->weight.to(wide), norm->bias.to(wide), options.eps());
  return normed.to(dtype).permute({0, 3, 1, 2});
}

bool IsForKernel(const torch::Tensor& x) { return HasKernel(x) && !torch::GradMode::is_enabled() && x.numel() > 0; }

}  // namespace

torch::Tensor NormChannels(const torch::Tensor& map, const torch::nn::LayerNorm& norm) {
  if (!IsForKernel(map) || norm->weight.scalar_type() != map.scalar_type()) return NormPlain(map, norm);
  const torch::Tensor pixels = map.contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor out = torch::empty_like(pixels);
  map.scalar_type() == torch::kBFloat16 ? NormInto<Bf16>(pixels, norm, out) : NormInto<float>(pixels, norm, out);
  return out;
}

torch::Tensor Gelu(const torch::Tensor& x) {
  if (!IsForKernel(x) || !x.is_contiguous(torch::MemoryFormat::ChannelsLast)) return torch::gelu(x);
  at::parallel_for(0, x.numel(), kGrainValues, [&](int64_t begin, int64_t end) {
    x.scalar_type() == torch::kBFloat16 ? GeluValues(KernelData<Bf16>(x), begin, end)
                                        : GeluValues(KernelData<float>(x), begin, end);
  });
  return x;
}

}  // namespace holdfast
