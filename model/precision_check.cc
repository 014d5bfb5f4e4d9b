// SPDX-License-Identifier: Apache-2.0
#include "model/precision_check.h"

#include <torch/types.h>
#include <torch/utils.h>

#include <algorithm>
#include <cstdio>
#include <vector>

#include "model/ops/sampling.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

constexpr int64_t kFrames = 8;  // of the window; every layer of the update block sees neighbours on both sides
constexpr int64_t kPointsASide = 4;
constexpr int64_t kIterations = 2;

// [kPointsASide^2, 2] float32: a grid over a map of this size, off its pixels.
torch::Tensor GridOver(int64_t height, int64_t width) {
  const torch::Tensor share = (torch::arange(kPointsASide, torch::kFloat32) + 0.5) / kPointsASide;
  const torch::Tensor x = (share * static_cast<double>(width - 1)).repeat({kPointsASide});
  const torch::Tensor y = (share * static_cast<double>(height - 1)).repeat_interleave(kPointsASide);
  return torch::stack({x, y}, 1);
}

// Positions after a window in which nothing moves, [points, kFrames, 2] float32 feature pixels.
torch::Tensor RunWindow(PointModel& model, const torch::Tensor& map) {
  const FeaturePyramid pyramid = BuildPyramid(map, model->options().correlation_levels);
  const torch::Tensor xy = GridOver(map.size(1), map.size(2));
  WindowRows rows;
  rows.frames.assign(kFrames, pyramid);
  rows.start = xy.unsqueeze(1).repeat({1, kFrames, 1});
  rows.feature = SampleFeatures(pyramid, xy);
  return model->Refine({rows}, {kIterations, false}).front().positions.to(torch::kCPU);
}

double RootMeanSquare(const torch::Tensor& x) { return x.to(torch::kDouble).square().mean().sqrt().item<double>(); }

}  // namespace

std::string ToString(const PrecisionDifference& difference) {
  char text[96];
  std::snprintf(text, sizeof(text), "features differ by %.3g, positions by %.3g px", difference.features,
                difference.positions);
  return text;
}

PrecisionDifference ComparePrecisions(PointModel exact, PointModel fast, const torch::Tensor& picture) {
  CheckTensor("picture", picture, {-1, -1, 3}, torch::kUInt8);
  const c10::InferenceMode guard;
  const torch::Tensor frames = picture.unsqueeze(0);
  const torch::Tensor exact_map = exact->Encode(frames)[0], fast_map = fast->Encode(frames)[0];
  const torch::Tensor wide = exact_map.to(torch::kFloat32);
  PrecisionDifference result;
  result.features = RootMeanSquare(fast_map.to(torch::kFloat32) - wide) / std::max(1e-30, RootMeanSquare(wide));
  const torch::Tensor moved = RunWindow(exact, exact_map) - RunWindow(fast, fast_map);
  result.positions = moved.norm(2, {2}).mean().item<double>() * static_cast<double>(exact->options().stride);
  return result;
}

PointModel CopyInPrecision(const PointModel& model, torch::ScalarType dtype) {
  const torch::NoGradGuard no_grad;
  PointModel copy(model->options());
  const std::vector<torch::Tensor> from = model->parameters();
  copy->to(from.front().device(), dtype);
  std::vector<torch::Tensor> to = copy->parameters();
  for (size_t i = 0; i < to.size(); ++i) to[i].copy_(from[i]);
  copy->eval();
  return copy;
}

torch::Tensor CheckPicture(int64_t height, int64_t width) {
  const torch::Tensor y = torch::arange(height, torch::kFloat32).view({-1, 1, 1});
  const torch::Tensor x = torch::arange(width, torch::kFloat32).view({1, -1, 1});
  const torch::Tensor colour = torch::arange(3, torch::kFloat32);
  const torch::Tensor coarse = torch::sin(x / 37 + y / 53 + colour) + torch::sin(x / 11 - y / 17 + 2 * colour);
  const torch::Tensor grain = torch::frac(torch::sin(x * 12.9898 + y * 78.233 + colour) * 43758.5453);
  return (128 + 40 * coarse + 40 * grain).clamp(0, 255).to(torch::kUInt8);
}

}  // namespace holdfast
