// SPDX-License-Identifier: Apache-2.0
#include "model/refinement.h"

#include <torch/types.h>

#include "model/ops/correlation.h"
#include "model/ops/kernel_type.h"
#include "model/ops/sampling.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

constexpr int64_t kShortLag = 2;  // frames back to f2
constexpr int64_t kLongLag = 4;   // and to f4

// x [N, S, C] -> the same, frame t holding what was at frame max(t - lag, 0).
torch::Tensor Lagged(const torch::Tensor& x, int64_t lag) {
  const torch::Tensor frame = torch::arange(x.size(1), x.options().dtype(torch::kLong));
  return x.index_select(1, (frame - lag).clamp_min(0));
}

void CheckWindow(const WindowRows& group, const WindowRows& first, const ModelOptions& options) {
  const int64_t channels = options.feature_channels;
  const auto frames = static_cast<int64_t>(group.frames.size());
  TORCH_CHECK(frames >= 2 && group.frames.size() == first.frames.size(), "frames: windows must be of one length, got ",
              frames);
  for (const auto& frame : group.frames) {
    TORCH_CHECK(static_cast<int64_t>(frame.levels.size()) == options.correlation_levels, "frames: want ",
                options.correlation_levels, " pyramid levels, got ", frame.levels.size());
    for (const auto& level : frame.levels) {
      CheckTensor("frames", level, {-1, -1, channels}, first.frames.front().levels.front().scalar_type());
      TORCH_CHECK(level.is_contiguous(), "frames: levels must be contiguous");
    }
  }
  CheckTensor("start", group.start, {-1, frames, 2});
  CheckFloating("feature", group.feature, {group.start.size(0), channels});
  TORCH_CHECK(group.carried_f2.defined() == group.carried_f4.defined(), "carried_f2 and carried_f4 go together");
  if (!group.carried_f2.defined()) return;
  CheckFloating("carried_f2", group.carried_f2, {group.start.size(0), frames, channels});
  CheckFloating("carried_f4", group.carried_f4, {group.start.size(0), frames, channels});
}

}  // namespace

torch::Tensor StackTemplates(const torch::Tensor& feature, const torch::Tensor& sampled) {
  return torch::stack({feature, Lagged(sampled, kShortLag), Lagged(sampled, kLongLag)}, 2);
}

torch::Tensor JoinTemplates(const torch::Tensor& correlations) {
  if (correlations.size(2) > 1) return correlations.flatten(2);
  return correlations.expand({-1, -1, 3, -1}).flatten(2);
}

void CheckWindows(const std::vector<WindowRows>& groups, const ModelOptions& options) {
  for (const auto& group : groups) CheckWindow(group, groups.front(), options);
}

Refinement::Refinement(const std::vector<WindowRows>& groups, const ModelOptions& options, torch::Device device)
    : groups_(groups), radius_(options.correlation_radius) {
  std::vector<torch::Tensor> starts;
  std::vector<torch::Tensor> features;
  const bool kernels = HasKernel(groups.front().frames.front().levels.front());
  for (const auto& group : groups) {
    rows_.push_back(group.start.size(0));
    kernels ? views_.Add(group.frames, rows_.back()) : joined_.push_back(JoinPyramids(group.frames));
    starts.push_back(group.start.to(device));
    features.push_back(group.feature.to(device, torch::kFloat32));
  }
  positions_ = torch::cat(starts).contiguous();
  feature_ = torch::cat(features).unsqueeze(1).expand({-1, positions_.size(1), -1});
  last_step_ = torch::zeros({positions_.size(0), positions_.size(1)}, positions_.options());
  iterations_ = torch::zeros({positions_.size(0)}, positions_.options().dtype(torch::kLong));
  const torch::Tensor group = torch::arange(static_cast<int64_t>(groups.size()));
  group_of_row_ = group.repeat_interleave(torch::tensor(rows_));
}

torch::Tensor Refinement::Moving(const torch::Tensor& all) const {
  return moving_.defined() ? all.index_select(0, moving_) : all;
}

void Refinement::Set(torch::Tensor& all, const torch::Tensor& moving) const {
  all = moving_.defined() ? all.index_copy(0, moving_, moving) : moving;
}

// rows [any] int64 on the CPU, in rising order: what Sample and Correlate are about.
void Refinement::LookAt(const torch::Tensor& rows) {
  const torch::Tensor of_row = group_of_row_.index_select(0, rows);
  const torch::Tensor counts = torch::bincount(of_row, {}, static_cast<int64_t>(groups_.size()));
  rows_.assign(counts.data_ptr<int64_t>(), counts.data_ptr<int64_t>() + counts.numel());
  if (!joined_.empty()) return;
  views_.window_of_row.assign(of_row.data_ptr<int64_t>(), of_row.data_ptr<int64_t>() + of_row.numel());
}

// f1 alone, unless some rows bring their f2 and f4 along.
torch::Tensor Refinement::FirstTemplates() const {
  bool carried = false;
  for (const auto& group : groups_) carried = carried || group.carried_f2.defined();
  if (!carried) return feature_.unsqueeze(2);
  std::vector<torch::Tensor> short_lag;
  std::vector<torch::Tensor> long_lag;
  int64_t row = 0;
  for (size_t g = 0; g < groups_.size(); ++g) {
    const torch::Tensor own = feature_.narrow(0, row, rows_[g]);
    const bool has = groups_[g].carried_f2.defined();
    short_lag.push_back(has ? groups_[g].carried_f2.to(own.device(), torch::kFloat32) : own);
    long_lag.push_back(has ? groups_[g].carried_f4.to(own.device(), torch::kFloat32) : own);
    row += rows_[g];
  }
  return torch::stack({feature_, torch::cat(short_lag), torch::cat(long_lag)}, 2);
}

torch::Tensor Refinement::Sample() const {
  const torch::Tensor xy = positions();
  if (joined_.empty()) return SampleRows(views_, xy);
  std::vector<torch::Tensor> parts;
  int64_t row = 0;
  for (size_t g = 0; g < joined_.size(); row += rows_[g++]) {
    parts.push_back(SampleRows(joined_[g], xy.narrow(0, row, rows_[g])));
  }
  return torch::cat(parts);
}

torch::Tensor Refinement::Correlate(const torch::Tensor& templates) const {
  const torch::Tensor xy = positions();
  if (joined_.empty()) return holdfast::Correlate(views_, templates, xy, radius_);
  std::vector<torch::Tensor> parts;
  int64_t row = 0;
  for (size_t g = 0; g < joined_.size(); row += rows_[g++]) {
    parts.push_back(
        holdfast::Correlate(joined_[g], templates.narrow(0, row, rows_[g]), xy.narrow(0, row, rows_[g]), radius_));
  }
  return torch::cat(parts);
}

torch::Tensor Refinement::Correlations() {
  templates_ = started_ ? StackTemplates(Moving(feature_), Sample()) : FirstTemplates();
  started_ = true;
  return JoinTemplates(Correlate(templates_));
}

void Refinement::Advance(const torch::Tensor& out) {
  torch::Tensor step = out.narrow(2, 0, 2).clone();
  step.select(1, 0).zero_();
  Set(positions_, positions() + step);
  Set(last_step_, step.norm(2, {2}));
  Set(iterations_, Moving(iterations_) + 1);
  if (out.size(2) == 3) Set(visibility_, out.select(2, 2));
}

bool Refinement::Settle(double least) {
  if (least <= 0) return true;
  // What is not a number goes on.
  const torch::Tensor still = Moving(last_step_).amax(1).lt(least);
  const torch::Tensor left = still.logical_not().nonzero().squeeze(1);
  if (left.size(0) == still.size(0)) return true;
  moving_ = moving_.defined() ? moving_.index_select(0, left) : left;
  LookAt(moving_.cpu());
  return left.size(0) > 0;
}

std::vector<WindowEstimate> Refinement::Estimates(bool keep_templates) {
  if (moving_.defined()) {
    moving_.reset();
    LookAt(torch::arange(group_of_row_.size(0)));
  }
  const torch::Tensor similarity = torch::cosine_similarity(feature_, Sample(), 2, 1e-8);
  std::vector<WindowEstimate> result;
  int64_t row = 0;
  for (const int64_t rows : rows_) {
    const auto own = [&](const torch::Tensor& x) { return x.narrow(0, row, rows); };
    WindowEstimate estimate;
    estimate.positions = own(positions_);
    if (visibility_.defined()) estimate.visibility_logit = own(visibility_);
    estimate.similarity = own(similarity);
    estimate.last_step = own(last_step_);
    estimate.iterations = own(iterations_);
    if (keep_templates && templates_.defined()) {
      const int64_t count = templates_.size(2);
      estimate.f2 = own(templates_).select(2, std::min<int64_t>(1, count - 1)).contiguous();
      estimate.f4 = own(templates_).select(2, count - 1).contiguous();
    }
    result.push_back(std::move(estimate));
    row += rows;
  }
  return result;
}

}  // namespace holdfast
