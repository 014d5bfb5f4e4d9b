// SPDX-License-Identifier: Apache-2.0
#include "model/ops/instance_norm.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>

#include "model/kernels/instance_norm.h"
#include "model/ops/kernel_type.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

torch::Tensor ChannelsLast(const torch::Tensor& x) { return x.contiguous(torch::MemoryFormat::ChannelsLast); }

// Blocks of about this many values are one task of parallel_for.
int64_t GrainBlocks(int64_t channels) { return std::max<int64_t>(1, 32768 / (kNormBlock * channels)); }

template <typename T>
NormMaps<T> MapsOf(const torch::Tensor& x, NormTail tail) {
  NormMaps<T> maps;
  maps.pixels = x.size(2) * x.size(3);
  maps.channels = x.size(1);
  maps.tail = tail;
  maps.x = KernelData<T>(x);
  return maps;
}

torch::Tensor PartialFor(const torch::Tensor& x) {
  const int64_t blocks = NormBlocks(x.size(2) * x.size(3));
  return torch::empty({x.size(0), blocks, 2, x.size(1)}, x.options().dtype(torch::kFloat32));
}

// Of x [N, C, H, W] channels-last -> moments [N, 2, C] float32.
template <typename T>
void TakeMoments(const torch::Tensor& x, const torch::Tensor& moments) {
  NormMaps<T> maps = MapsOf<T>(x, NormTail::kNone);
  const torch::Tensor partial = PartialFor(x);
  maps.partial = partial.data_ptr<float>();
  maps.moments = moments.data_ptr<float>();
  const int64_t blocks = partial.size(1);
  at::parallel_for(0, x.size(0) * blocks, GrainBlocks(maps.channels),
                   [&](int64_t begin, int64_t end) { NormBlockMoments(maps, begin, end); });
  for (int64_t n = 0; n < x.size(0); ++n) {
    const int64_t stride = 2 * maps.channels;
    NormJoinMoments(maps.partial + n * blocks * stride, {maps.pixels, kNormBlock}, maps.channels,
                    maps.moments + n * stride);
  }
}

// x, identity and y [N, C, H, W] channels-last of one dtype; moments [N, 2, C] float32.
template <typename T>
void ApplyMoments(const torch::Tensor& x, const torch::Tensor& identity, NormTail tail, const torch::Tensor& y,
                  const torch::Tensor& moments) {
  NormMaps<T> maps = MapsOf<T>(x, tail);
  maps.moments = moments.data_ptr<float>();
  maps.y = KernelData<T>(y);
  if (identity.defined()) maps.identity = KernelData<T>(identity);
  at::parallel_for(0, x.size(0) * NormBlocks(maps.pixels), GrainBlocks(maps.channels),
                   [&](int64_t begin, int64_t end) { NormApply(maps, begin, end); });
}

struct SavedNorm {
  torch::Tensor x;
  torch::Tensor y;
  torch::Tensor moments;
};

// grad_identity may be undefined for tails without one.
template <typename T>
void Backward(const SavedNorm& saved, NormTail tail, const torch::Tensor& grad_y, const torch::Tensor& grad_x,
              const torch::Tensor& grad_identity) {
  NormMaps<T> maps = MapsOf<T>(saved.x, tail);
  const torch::Tensor partial = PartialFor(saved.x);
  const torch::Tensor sums = torch::empty_like(saved.moments);
  maps.partial = partial.data_ptr<float>();
  maps.moments = saved.moments.data_ptr<float>();
  maps.sums = sums.data_ptr<float>();
  maps.y = KernelData<T>(saved.y);
  maps.grad_y = KernelData<T>(grad_y);
  maps.grad_x = KernelData<T>(grad_x);
  if (grad_identity.defined()) maps.grad_identity = KernelData<T>(grad_identity);
  const int64_t blocks = partial.size(1);
  const int64_t items = saved.x.size(0) * blocks;
  const int64_t grain = GrainBlocks(maps.channels);
  at::parallel_for(0, items, grain, [&](int64_t begin, int64_t end) { NormBlockGradients(maps, begin, end); });
  for (int64_t n = 0; n < saved.x.size(0); ++n) {
    const int64_t stride = 2 * maps.channels;
    NormJoinGradients(maps.partial + n * blocks * stride, maps.pixels, maps.channels, maps.sums + n * stride);
  }
  at::parallel_for(0, items, grain, [&](int64_t begin, int64_t end) { NormApplyGradients(maps, begin, end); });
}

torch::Tensor MomentsOf(const torch::Tensor& x) {
  const torch::Tensor moments = torch::empty({x.size(0), 2, x.size(1)}, x.options().dtype(torch::kFloat32));
  x.scalar_type() == torch::kBFloat16 ? TakeMoments<Bf16>(x, moments) : TakeMoments<float>(x, moments);
  return moments;
}

torch::Tensor Apply(const torch::Tensor& x, const torch::Tensor& identity, NormTail tail,
                    const torch::Tensor& moments) {
  const torch::Tensor y = torch::empty_like(x);
  x.scalar_type() == torch::kBFloat16 ? ApplyMoments<Bf16>(x, identity, tail, y, moments)
                                      : ApplyMoments<float>(x, identity, tail, y, moments);
  return y;
}

class NormFunction : public torch::autograd::Function<NormFunction> {
 public:
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& x, const torch::Tensor& identity,
                               int64_t tail) {
    const torch::Tensor moments = MomentsOf(x);
    const torch::Tensor y = Apply(x, identity, static_cast<NormTail>(tail), moments);
    ctx->save_for_backward({x, y, moments});
    ctx->saved_data["tail"] = tail;
    return y;
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const variable_list tensors = ctx->get_saved_variables();
    const SavedNorm saved{tensors[0], tensors[1], tensors[2]};
    const auto tail = static_cast<NormTail>(ctx->saved_data["tail"].toInt());
    const torch::Tensor grad_y = ChannelsLast(grads[0].to(saved.x.scalar_type()));
    const torch::Tensor grad_x = torch::empty_like(saved.x);
    torch::Tensor grad_identity;
    if (tail == NormTail::kReluAddRelu) grad_identity = torch::empty_like(saved.x);
    if (saved.x.scalar_type() == torch::kBFloat16) {
      Backward<Bf16>(saved, tail, grad_y, grad_x, grad_identity);
    } else {
      Backward<float>(saved, tail, grad_y, grad_x, grad_identity);
    }
    return {grad_x, grad_identity, torch::Tensor()};
  }
};

torch::Tensor Plain(const torch::Tensor& x, const torch::Tensor& identity, NormTail tail) {
  const torch::Tensor wide = x.scalar_type() == torch::kDouble ? x : x.to(torch::kFloat32);
  const torch::Tensor centred = wide - wide.mean({2, 3}, /*keepdim=*/true);
  torch::Tensor y = centred * (centred.square().mean({2, 3}, /*keepdim=*/true) + kNormEpsilon).rsqrt();
  if (tail != NormTail::kNone) y = torch::relu(y);
  if (tail == NormTail::kReluAddRelu) y = torch::relu(y + identity);
  return y.to(x.scalar_type());
}

torch::Tensor Run(const torch::Tensor& x, const torch::Tensor& identity, NormTail tail) {
  if (!HasKernel(x)) return Plain(x, identity, tail);
  const torch::Tensor map = ChannelsLast(x);
  const torch::Tensor other = identity.defined() ? ChannelsLast(identity.to(x.scalar_type())) : identity;
  const bool differentiable = x.requires_grad() || (identity.defined() && identity.requires_grad());
  if (!differentiable || !torch::GradMode::is_enabled()) return Apply(map, other, tail, MomentsOf(map));
  // An autograd function takes no undefined tensors.
  return NormFunction::apply(map, other.defined() ? other : torch::empty({0}), static_cast<int64_t>(tail));
}

}  // namespace

torch::Tensor InstanceNorm(const torch::Tensor& x) { return Run(x, {}, NormTail::kNone); }
torch::Tensor InstanceNormRelu(const torch::Tensor& x) { return Run(x, {}, NormTail::kRelu); }
torch::Tensor InstanceNormReluAdd(const torch::Tensor& x, const torch::Tensor& identity) {
  return Run(x, identity, NormTail::kReluAddRelu);
}

MeasuredMap Measure(const torch::Tensor& x) {
  const bool useful = HasKernel(x) && x.scalar_type() == torch::kFloat32 && !torch::GradMode::is_enabled();
  if (!useful) return {x, {}};
  const torch::Tensor map = ChannelsLast(x);
  return {map, MomentsOf(map)};
}

torch::Tensor InstanceNormRelu(const MeasuredMap& x) {
  if (!x.moments.defined()) return InstanceNormRelu(x.map);
  return Apply(x.map, {}, NormTail::kRelu, x.moments);
}

torch::Tensor InstanceNormReluAdd(const MeasuredMap& x, const torch::Tensor& identity) {
  if (!x.moments.defined()) return InstanceNormReluAdd(x.map, identity);
  return Apply(x.map, ChannelsLast(identity.to(x.map.scalar_type())), NormTail::kReluAddRelu, x.moments);
}

}  // namespace holdfast
