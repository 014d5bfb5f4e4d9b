// SPDX-License-Identifier: Apache-2.0
#include "model/ops/resize.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>

#include <vector>

#include "model/kernels/resize.h"
#include "model/ops/kernel_type.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr int64_t kGrainRows = 16;

struct Places {
  std::vector<ResizePlace> rows;
  std::vector<ResizePlace> columns;
};

// source [F, C, H, W], target [F, C, h, w]; 'places' must outlive the result.
template <typename T>
ResizedMaps<T> MapsOf(const torch::Tensor& source, const torch::Tensor& target, Places& places) {
  ResizedMaps<T> maps;
  maps.channels = source.size(1);
  maps.height = source.size(2);
  maps.width = source.size(3);
  maps.out_height = target.size(2);
  maps.out_width = target.size(3);
  places = {ResizePlaces(maps.out_height, maps.height), ResizePlaces(maps.out_width, maps.width)};
  maps.rows = places.rows.data();
  maps.columns = places.columns.data();
  return maps;
}

template <typename T>
void Forward(const torch::Tensor& map, const torch::Tensor& out) {
  Places places;
  ResizedMaps<T> maps = MapsOf<T>(map, out, places);
  maps.map = KernelData<T>(map);
  maps.out = KernelData<T>(out);
  at::parallel_for(0, out.size(0) * maps.out_height, kGrainRows,
                   [&](int64_t begin, int64_t end) { ResizeRows(maps, begin, end); });
}

torch::Tensor RunForward(const torch::Tensor& map, int64_t height, int64_t width) {
  const torch::Tensor source = map.contiguous(torch::MemoryFormat::ChannelsLast);
  const torch::Tensor out =
      torch::empty({map.size(0), map.size(1), height, width}, map.options(), torch::MemoryFormat::ChannelsLast);
  map.scalar_type() == torch::kBFloat16 ? Forward<Bf16>(source, out) : Forward<float>(source, out);
  return out;
}

template <typename T>
void Backward(const torch::Tensor& grad_out, const torch::Tensor& grad) {
  Places places;
  ResizedMaps<T> maps = MapsOf<T>(grad, grad_out, places);
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
    return RunForward(map, height, width);
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const torch::Tensor grad_out = grads[0].contiguous(torch::MemoryFormat::ChannelsLast);
    const torch::Tensor grad =
        torch::empty(ctx->saved_data["sizes"].toIntVector(), grad_out.options(), torch::MemoryFormat::ChannelsLast);
    grad.scalar_type() == torch::kBFloat16 ? Backward<Bf16>(grad_out, grad) : Backward<float>(grad_out, grad);
    return {grad, torch::Tensor(), torch::Tensor()};
  }
};

}  // namespace

torch::Tensor ResizeBilinear(const torch::Tensor& map, int64_t height, int64_t width) {
  CheckFloating("map", map, {-1, -1, -1, -1});
  TORCH_CHECK(map.size(2) > 0 && map.size(3) > 0 && height > 0 && width > 0, "map: cannot be resized from ",
              map.sizes(), " to ", height, " x ", width);
  if (map.size(2) == height && map.size(3) == width) return map;
  if (!HasKernel(map)) return at::upsample_bilinear2d(map, {height, width}, /*align_corners=*/true);
  if (!map.requires_grad() || !torch::GradMode::is_enabled()) return RunForward(map, height, width);
  return ResizeFunction::apply(map, height, width);
}

}  // namespace holdfast
