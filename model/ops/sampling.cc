// SPDX-License-Identifier: Apache-2.0
#include "model/ops/sampling.h"

#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "model/kernels/correlation.h"
#include "model/ops/kernel_type.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr int64_t kSamplingGrain = 64;

torch::Tensor Forward(const FeatureViews& views, const torch::Tensor& xy) {
  const torch::Tensor out = torch::empty({views.rows(), views.frames, views.channels}, torch::kFloat32);
  SampledRows rows;
  rows.maps = views.row_maps();
  rows.xy = xy.data_ptr<float>();
  rows.out = out.data_ptr<float>();
  const bool bfloat16 = views.dtype == torch::kBFloat16;
  at::parallel_for(0, views.rows() * views.frames, kSamplingGrain, [&](int64_t begin, int64_t end) {
    bfloat16 ? SampleItems(rows, Bf16{}, begin, end) : SampleItems(rows, 0.0f, begin, end);
  });
  return out;
}

class SampleFunction : public torch::autograd::Function<SampleFunction> {
 public:
  static torch::Tensor forward(AutogradContext* ctx, const torch::Tensor& cells, const torch::Tensor& xy,
                               const PyramidCells& window) {
    FeatureViews views;
    views.Add({cells, window.sizes}, xy.size(0));
    ctx->save_for_backward({xy});
    ctx->saved_data["height"] = window.sizes.front().first;
    ctx->saved_data["width"] = window.sizes.front().second;
    ctx->saved_data["cells"] = cells.size(1);
    ctx->saved_data["dtype"] = static_cast<int64_t>(cells.scalar_type());
    return Forward(views, xy);
  }

  static variable_list backward(AutogradContext* ctx, variable_list grads) {
    const torch::Tensor xy = ctx->get_saved_variables()[0];
    const torch::Tensor grad_out = grads[0].contiguous();
    PyramidCells gradient;
    gradient.sizes = {{ctx->saved_data["height"].toInt(), ctx->saved_data["width"].toInt()}};
    gradient.cells = torch::zeros({xy.size(1), ctx->saved_data["cells"].toInt(), grad_out.size(2)}, torch::kFloat32);
    FeatureViews views;
    views.Add(gradient, xy.size(0));
    SampledRows rows;
    rows.maps = views.row_maps();
    rows.xy = xy.data_ptr<float>();
    rows.grad_out = grad_out.data_ptr<float>();
    rows.grad_maps = views.maps.data();
    at::parallel_for(0, views.frames, 1, [&](int64_t begin, int64_t end) { SampleFramesBackward(rows, begin, end); });
    const auto dtype = static_cast<torch::ScalarType>(ctx->saved_data["dtype"].toInt());
    return {gradient.cells.to(dtype), torch::Tensor(), torch::Tensor()};
  }
};

}  // namespace

torch::Tensor SampleRows(const FeatureViews& views, const torch::Tensor& xy) {
  CheckTensor("xy", xy, {views.rows(), views.frames, 2});
  return Forward(views, xy.contiguous());
}

torch::Tensor SampleRows(const PyramidCells& window, const torch::Tensor& xy) {
  if (!HasKernel(window.cells)) return SampleRowsPlain(window, xy);
  CheckTensor("xy", xy, {-1, window.frames(), 2});
  return SampleFunction::apply(window.cells, xy.detach().contiguous(), window);
}

torch::Tensor SampleRowsPlain(const PyramidCells& window, const torch::Tensor& xy) {
  const auto [height, width] = window.sizes.front();
  const torch::Tensor by_frame = xy.detach().to(torch::promote_types(window.cells.scalar_type(), torch::kFloat32));
  const torch::Tensor x = by_frame.select(2, 0).t().nan_to_num().clamp(0, width - 1);  // [S, N]
  const torch::Tensor y = by_frame.select(2, 1).t().nan_to_num().clamp(0, height - 1);
  const torch::Tensor x0 = x.floor();
  const torch::Tensor y0 = y.floor();
  const auto cell = [&, width = width, height = height](int64_t dx, int64_t dy) {
    const torch::Tensor column = (x0 + dx).clamp_max(width - 1).to(torch::kLong);
    const torch::Tensor row = (y0 + dy).clamp_max(height - 1).to(torch::kLong);
    const torch::Tensor index = (row * width + column).unsqueeze(2).expand({-1, -1, window.channels()});
    return window.cells.gather(1, index).to(x.scalar_type());
  };
  const torch::Tensor fx = (x - x0).unsqueeze(2);
  const torch::Tensor fy = (y - y0).unsqueeze(2);
  const torch::Tensor top = cell(0, 0) * (1 - fx) + cell(1, 0) * fx;
  const torch::Tensor bottom = cell(0, 1) * (1 - fx) + cell(1, 1) * fx;
  return (top * (1 - fy) + bottom * fy).transpose(0, 1);
}

torch::Tensor SampleFeatures(const FeaturePyramid& frame, const torch::Tensor& xy) {
  CheckTensor("xy", xy, {-1, 2});
  const torch::NoGradGuard no_grad;
  const torch::Tensor at = xy.to(frame.levels.front().device()).unsqueeze(1);
  if (!HasKernel(frame.levels.front())) return SampleRowsPlain(JoinPyramids({frame}), at).squeeze(1);
  FeatureViews views;
  views.Add(std::vector<FeaturePyramid>{frame}, xy.size(0));
  return Forward(views, at.contiguous()).squeeze(1);
}

}  // namespace holdfast
