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

// out: channels-last, or some channels of such maps.
template <typename T>
void Forward(const torch::Tensor& map, const torch::Tensor& out) {
  Places places;
  ResizedMaps<T> maps = MapsOf<T>(map, out, places);
  maps.map = KernelData<T>(map);
  maps.out = KernelData<T>(out);
  maps.out_step = out.stride(3);
  at::parallel_for(0, out.size(0) * maps.out_height, kGrainRows,
                   [&](int64_t begin, int64_t end) { ResizeRows(maps, begin, end); });
}

void ForwardInto(const torch::Tensor& map, const torch::Tensor& out) {
  const torch::Tensor source = map.contiguous(torch::MemoryFormat::ChannelsLast);
  map.scalar_type() == torch::kBFloat16 ? Forward<Bf16>(source, out) : Forward<float>(source, out);
}

torch::Tensor EmptyMap(const torch::Tensor& like, int64_t channels, int64_t height, int64_t width) {
  return torch::empty({like.size(0), channels, height, width}, like.options(), torch::MemoryFormat::ChannelsLast);
}

torch::Tensor RunForward(const torch::Tensor& map, int64_t height, int64_t width) {
  const torch::Tensor out = EmptyMap(map, map.size(1), height, width);
  ForwardInto(map, out);
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

torch::Tensor ResizeAndJoin(const std::vector<torch::Tensor>& maps, int64_t height, int64_t width) {
  int64_t channels = 0;
  bool in_place = !torch::GradMode::is_enabled();
  for (const auto& map : maps) {
    in_place = in_place && HasKernel(map) && map.scalar_type() == maps.front().scalar_type();
    channels += map.size(1);
  }
  if (!in_place) {
    std::vector<torch::Tensor> resized;
    resized.reserve(maps.size());
    for (const auto& map : maps) resized.push_back(ResizeBilinear(map, height, width));
    return torch::cat(resized, 1);
  }
  const torch::Tensor joined = EmptyMap(maps.front(), channels, height, width);
  int64_t first = 0;
  for (const auto& map : maps) {
    const torch::Tensor part = joined.narrow(1, first, map.size(1));
    if (map.size(2) == height && map.size(3) == width) {
      part.copy_(map);
    } else {
      ForwardInto(map, part);
    }
    first += map.size(1);
  }
  return joined;
}

}  // namespace holdfast
