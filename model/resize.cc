// SPDX-License-Identifier: Apache-2.0
#include "model/resize.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/torch.h>

#include <vector>

#include "model/kernel_type.h"
#include "model/resize_kernel.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr int64_t kGrainRows = 16;

torch::Tensor Forward(const torch::Tensor& map, int64_t height, int64_t width) {
  return at::upsample_bilinear2d(map, {height, width}, /*align_corners=*/true);
}

template <typename T>
void Backward(const torch::Tensor& grad_out, const torch::Tensor& grad) {
  ResizedMaps<T> maps;
  maps.channels = grad.size(1);
  maps.height = grad.size(2);
  maps.width = grad.size(3);
  maps.out_height = grad_out.size(2);
  maps.out_width = grad_out.size(3);
  maps.grad_out = KernelData<T>(grad_out);
  maps.grad = KernelData<T>(grad);
  at::parallel_for(0, grad.size(0) * maps.height, kGrainRows, [&](int64_t begin, int64_t end) {
    std::vector<float> row(static_cast<size_t>(maps.width * maps.channels));
    ResizeGradients(maps, begin, end, row.data());
  });
}

// ATen's own backward pass goes through maps that are not channels-last: three times the time.
class ResizeFunction : public torch::autograd::Function<ResizeFunction> {
 public:
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& map, int64_t height, int64_t width) {
    ctx->saved_data["sizes"] = map.sizes();
    return Forward(map, height, width);
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const torch::Tensor grad_out = grads[0].contiguous(torch::MemoryFormat::ChannelsLast);
    const torch::Tensor grad =
        torch::empty(ctx->saved_data["sizes"].toIntVector(), grad_out.options(), torch::MemoryFormat::ChannelsLast);
    if (grad.scalar_type() == torch::kBFloat16) {
      Backward<Bf16>(grad_out, grad);
    } else {
      Backward<float>(grad_out, grad);
    }
    return {grad, torch::Tensor(), torch::Tensor()};
  }
};

}  // namespace

torch::Tensor ResizeBilinear(const torch::Tensor& map, int64_t height, int64_t width) {
  if (map.size(2) == height && map.size(3) == width) return map;
  if (!HasKernel(map) || !map.requires_grad() || !torch::GradMode::is_enabled()) return Forward(map, height, width);
  return ResizeFunction::apply(map, height, width);
}

}  // namespace holdfast
