// SPDX-License-Identifier: Apache-2.0
#include "model/ops/patch_attention.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>

#include <cmath>

#include "model/kernels/attention.h"
#include "model/ops/kernel_type.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

template <typename T>
AttentionMaps<T> MapsOf(const torch::Tensor& query, const torch::Tensor& value, const torch::Tensor& out,
                        const AttentionShape& shape) {
  AttentionMaps<T> maps;
  maps.height = query.size(1);
  maps.width = query.size(2);
  maps.channels = query.size(3);
  maps.heads = shape.heads;
  maps.patch = shape.patch;
  maps.query = KernelData<T>(query);
  maps.value = KernelData<T>(value);
  maps.out = KernelData<T>(out);
  return maps;
}

template <typename T>
void Forward(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape,
             const torch::Tensor& out) {
  const AttentionMaps<T> maps = MapsOf<T>(query, value, out, shape);
  at::parallel_for(0, query.size(0) * maps.heads * maps.patch_rows(), 1, [&](int64_t begin, int64_t end) {
    std::vector<float> scratch(static_cast<size_t>(maps.scratch_floats()));
    AttendItems(maps, scratch.data(), begin, end);
  });
}

torch::Tensor RunForward(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape) {
  const torch::Tensor out = torch::empty_like(query);
  query.scalar_type() == torch::kBFloat16 ? Forward<Bf16>(query, value, shape, out)
                                          : Forward<float>(query, value, shape, out);
  return out;
}

// saved: query, value, out -> gradients of query and value, float32.
template <typename T>
variable_list Backward(const variable_list& saved, const AttentionShape& shape, const torch::Tensor& grad_out) {
  const auto wide = saved[0].options().dtype(torch::kFloat32);
  const torch::Tensor grad_query = torch::empty(saved[0].sizes(), wide);
  const torch::Tensor grad_value = torch::zeros(saved[1].sizes(), wide);
  AttentionMaps<T> maps = MapsOf<T>(saved[0], saved[1], saved[2], shape);
  maps.grad_out = KernelData<T>(grad_out);
  maps.grad_query = grad_query.data_ptr<float>();
  maps.grad_value = grad_value.data_ptr<float>();
  at::parallel_for(0, saved[0].size(0) * maps.heads, 1, [&](int64_t begin, int64_t end) {
    std::vector<float> scratch(static_cast<size_t>(maps.scratch_floats()));
    AttendBackwardItems(maps, scratch.data(), begin, end);
  });
  return {grad_query, grad_value};
}

class AttentionFunction : public torch::autograd::Function<AttentionFunction> {
 public:
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& query, const torch::Tensor& value,
                               int64_t heads, int64_t patch) {
    const torch::Tensor out = RunForward(query, value, {heads, patch});
    ctx->save_for_backward({query, value, out});
    ctx->saved_data["heads"] = heads;
    ctx->saved_data["patch"] = patch;
    return out;
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const variable_list saved = ctx->get_saved_variables();
    const AttentionShape shape{ctx->saved_data["heads"].toInt(), ctx->saved_data["patch"].toInt()};
    const torch::ScalarType dtype = saved[0].scalar_type();
    const torch::Tensor grad_out = grads[0].to(dtype).contiguous();
    const variable_list result =
        dtype == torch::kBFloat16 ? Backward<Bf16>(saved, shape, grad_out) : Backward<float>(saved, shape, grad_out);
    return {result[0].to(dtype), result[1].to(dtype), torch::Tensor(), torch::Tensor()};
  }
};

// [F, C, rows * M, columns * M], zero beyond the map -> windows of 'side' every M, 'margin' around: [F, C, P, side^2]
torch::Tensor Windows(const torch::Tensor& padded, int64_t side, int64_t step) {
  return padded.unfold(2, side, step).unfold(3, side, step).flatten(4, 5).flatten(2, 3);
}

}  // namespace

torch::Tensor PatchAttention(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape) {
  if (!HasKernel(query)) return PatchAttentionPlain(query, value, shape);
  const torch::Tensor q = query.contiguous();
  const torch::Tensor v = value.contiguous();
  const bool differentiable = torch::GradMode::is_enabled() && (q.requires_grad() || v.requires_grad());
  if (!differentiable) return RunForward(q, v, shape);
  return AttentionFunction::apply(q, v, shape.heads, shape.patch);
}

torch::Tensor PatchAttentionPlain(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape) {
  const int64_t m = shape.patch;
  const int64_t frames = query.size(0);
  const int64_t height = query.size(1);
  const int64_t width = query.size(2);
  const int64_t depth = query.size(3) / shape.heads;
  const int64_t down = (m - height % m) % m;
  const int64_t right = (m - width % m) % m;
  const auto split = [&](const torch::Tensor& windows) {  // [F, C, P, T] -> [F, heads, P, T, D]
    return windows.unflatten(1, {shape.heads, depth}).permute({0, 1, 3, 4, 2});
  };
  const torch::Tensor q = torch::constant_pad_nd(query.permute({0, 3, 1, 2}), {0, right, 0, down});
  const torch::Tensor v = torch::constant_pad_nd(value.permute({0, 3, 1, 2}), {m, right + m, m, down + m});
  const torch::Tensor on_map =
      torch::constant_pad_nd(torch::ones({1, 1, height, width}, query.options()), {m, right + m, m, down + m});
  const torch::Tensor keys = split(Windows(v, 3 * m, m));
  const torch::Tensor outside = Windows(on_map, 3 * m, m).eq(0).unsqueeze(3);  // [1, 1, P, 1, keys]
  torch::Tensor scores = torch::matmul(split(Windows(q, m, m)), keys.transpose(3, 4)) / std::sqrt(double(depth));
  scores = scores.masked_fill(outside, -std::numeric_limits<double>::infinity());
  const torch::Tensor tokens = torch::matmul(torch::softmax(scores, -1), keys);  // [F, heads, P, M^2, D]
  const int64_t rows = (height + down) / m;
  const int64_t columns = (width + right) / m;
  const torch::Tensor map = tokens.reshape({frames, shape.heads, rows, columns, m, m, depth})
                                .permute({0, 2, 4, 3, 5, 1, 6})
                                .reshape({frames, rows * m, columns * m, shape.heads * depth});
  return map.narrow(1, 0, height).narrow(2, 0, width).contiguous();
}

}  // namespace holdfast
