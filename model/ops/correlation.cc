// SPDX-License-Identifier: Apache-2.0
#include "model/ops/correlation.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>

#include <cmath>

#include "model/kernels/correlation.h"
#include "model/ops/kernel_type.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr int64_t kCorrelationGrain = 8;

CorrelationRows RowsOf(const FeatureViews& views, const torch::Tensor& templates, const torch::Tensor& xy,
                       int64_t radius) {
  CorrelationRows rows;
  rows.maps = views.row_maps();
  rows.radius = radius;
  rows.templates = templates.size(2);
  rows.features = templates.data_ptr<float>();
  rows.xy = xy.data_ptr<float>();
  return rows;
}

void CheckInputs(const torch::Tensor& templates, const torch::Tensor& xy, int64_t channels, int64_t radius) {
  CheckTensor("xy", xy, {-1, -1, 2});
  CheckTensor("templates", templates, {xy.size(0), xy.size(1), -1, channels});
  TORCH_CHECK(templates.size(2) >= 1 && templates.size(2) <= kMaxTemplates, "1 to ", kMaxTemplates, " templates");
  TORCH_CHECK(radius >= 0 && radius <= kMaxCorrelationRadius, "radius ", radius, " out of range");
}

torch::Tensor Forward(const FeatureViews& views, const torch::Tensor& templates, const torch::Tensor& xy,
                      int64_t radius) {
  const int64_t offsets = (2 * radius + 1) * (2 * radius + 1);
  const torch::Tensor out =
      torch::empty({views.rows(), views.frames, templates.size(2), views.levels * offsets}, torch::kFloat32);
  CorrelationRows rows = RowsOf(views, templates, xy, radius);
  rows.out = out.data_ptr<float>();
  const bool bfloat16 = views.dtype == torch::kBFloat16;
  at::parallel_for(0, views.rows() * views.frames, kCorrelationGrain, [&](int64_t begin, int64_t end) {
    bfloat16 ? CorrelateItems(rows, Bf16{}, begin, end) : CorrelateItems(rows, 0.0f, begin, end);
  });
  return out;
}

// Gradients of the window's cells (float32) and of the templates.
variable_list Backward(const PyramidCells& window, const torch::Tensor& templates, const torch::Tensor& xy,
                       const torch::Tensor& grad_out, int64_t radius) {
  PyramidCells gradient{torch::zeros(window.cells.sizes(), torch::kFloat32), window.sizes};
  const torch::Tensor grad_templates = torch::zeros_like(templates);
  FeatureViews views;
  FeatureViews gradient_views;
  views.Add(window, xy.size(0));
  gradient_views.Add(gradient, xy.size(0));
  CorrelationRows rows = RowsOf(views, templates, xy, radius);
  rows.grad_out = grad_out.data_ptr<float>();
  rows.grad_features = grad_templates.data_ptr<float>();
  rows.grad_maps = gradient_views.maps.data();
  const bool bfloat16 = views.dtype == torch::kBFloat16;
  at::parallel_for(0, views.frames, 1, [&](int64_t begin, int64_t end) {
    bfloat16 ? CorrelateFramesBackward(rows, Bf16{}, begin, end) : CorrelateFramesBackward(rows, 0.0f, begin, end);
  });
  return {gradient.cells.to(window.cells.scalar_type()), grad_templates};
}

class CorrelateFunction : public torch::autograd::Function<CorrelateFunction> {
 public:
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& cells, const torch::Tensor& templates,
                               const torch::Tensor& xy, const PyramidCells& window, int64_t radius) {
    std::vector<int64_t> sides;
    for (const auto& [height, width] : window.sizes) sides.insert(sides.end(), {height, width});
    ctx->save_for_backward({cells, templates, xy});
    ctx->saved_data["sides"] = sides;
    ctx->saved_data["radius"] = radius;
    FeatureViews views;
    views.Add({cells, window.sizes}, xy.size(0));
    return Forward(views, templates, xy, radius);
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const variable_list saved = ctx->get_saved_variables();
    const std::vector<int64_t> sides = ctx->saved_data["sides"].toIntVector();
    PyramidCells window{saved[0], {}};
    for (size_t i = 0; i < sides.size(); i += 2) window.sizes.emplace_back(sides[i], sides[i + 1]);
    const int64_t radius = ctx->saved_data["radius"].toInt();
    const variable_list result = Backward(window, saved[1], saved[2], grads[0].contiguous(), radius);
    return {result[0], result[1], torch::Tensor(), torch::Tensor(), torch::Tensor()};
  }
};

// One level of CorrelatePlain. map [S, H * W, C], xy [N, S, 2] in its pixels -> [N, S, K, (2R+1)^2].
torch::Tensor LevelPlain(const torch::Tensor& map, std::pair<int64_t, int64_t> size, const torch::Tensor& templates,
                         const torch::Tensor& xy, int64_t radius) {
  const int64_t side = 2 * radius + 2;
  const auto [height, width] = size;
  const torch::Tensor base = xy.floor().clamp(-1e6, 1e6);
  const torch::Tensor steps = torch::arange(side, xy.options()) - radius;
  const torch::Tensor x = (base.select(2, 0).unsqueeze(2) + steps).unsqueeze(3).expand({-1, -1, side, side});
  const torch::Tensor y = (base.select(2, 1).unsqueeze(2) + steps).unsqueeze(2).expand({-1, -1, side, side});
  const torch::Tensor inside = (x >= 0).logical_and(x < width).logical_and(y >= 0).logical_and(y < height);
  const torch::Tensor cell = y.clamp(0, height - 1) * width + x.clamp(0, width - 1);  // [N, S, side, side]
  const torch::Tensor frame = torch::arange(xy.size(1), xy.options().dtype(torch::kLong)).view({1, -1, 1});
  const torch::Tensor cells = map.index({frame, cell.flatten(2).to(torch::kLong)}).to(templates.scalar_type());
  torch::Tensor dots = torch::matmul(templates, cells.transpose(2, 3)).unflatten(3, {side, side});
  dots = dots * inside.unsqueeze(2);
  const torch::Tensor shift = (xy - base).unsqueeze(2).unsqueeze(3);  // [N, S, 1, 1, 2]
  const torch::Tensor fx = shift.select(4, 0).unsqueeze(4);
  const torch::Tensor fy = shift.select(4, 1).unsqueeze(4);
  dots = dots.narrow(4, 0, side - 1) * (1 - fy) + dots.narrow(4, 1, side - 1) * fy;
  dots = dots.narrow(3, 0, side - 1) * (1 - fx) + dots.narrow(3, 1, side - 1) * fx;
  return dots.flatten(3) / std::sqrt(static_cast<double>(templates.size(3)));
}

}  // namespace

torch::Tensor Correlate(const FeatureViews& views, const torch::Tensor& templates, const torch::Tensor& xy,
                        int64_t radius) {
  CheckInputs(templates, xy, views.channels, radius);
  return Forward(views, templates.contiguous(), xy.contiguous(), radius);
}

torch::Tensor Correlate(const PyramidCells& window, const torch::Tensor& templates, const torch::Tensor& xy,
                        int64_t radius) {
  if (!HasKernel(window.cells)) return CorrelatePlain(window, templates, xy, radius);
  CheckInputs(templates, xy, window.channels(), radius);
  return CorrelateFunction::apply(window.cells, templates.contiguous(), xy.detach().contiguous(), window, radius);
}

torch::Tensor CorrelatePlain(const PyramidCells& window, const torch::Tensor& templates, const torch::Tensor& xy,
                             int64_t radius) {
  std::vector<torch::Tensor> levels;
  int64_t first = 0;
  const torch::Tensor position = xy.detach().to(templates.scalar_type()).nan_to_num(1e6);
  for (size_t l = 0; l < window.sizes.size(); ++l) {
    const auto& size = window.sizes[l];
    const int64_t cells = size.first * size.second;
    const int64_t offsets = (2 * radius + 1) * (2 * radius + 1);
    if (cells == 0) {
      levels.push_back(templates.new_zeros({xy.size(0), xy.size(1), templates.size(2), offsets}));
    } else {
      const double scale = 1.0 / static_cast<double>(int64_t{1} << l);
      levels.push_back(LevelPlain(window.cells.narrow(1, first, cells), size, templates, position * scale, radius));
    }
    first += cells;
  }
  return torch::cat(levels, 3);
}

}  // namespace holdfast
