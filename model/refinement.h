// SPDX-License-Identifier: Apache-2.0
// The state of PointModelImpl::Refine between iterations: where the rows are and what they look at.
#pragma once

#include <torch/types.h>

#include <vector>

#include "model/ops/feature_views.h"
#include "model/point_model.h"

namespace holdfast {

// Templates f1, f2, f4 of each frame: [N, S, 3, C] from f1 [N, S, C] and the features 'sampled' [N, S, C] at the
// current estimates, taken two and four frames back (the first frame stands in for those before it).
torch::Tensor StackTemplates(const torch::Tensor& feature, const torch::Tensor& sampled);
// [N, S, K, D] -> [N, S, 3 * D]; a single template stands for all three.
torch::Tensor JoinTemplates(const torch::Tensor& correlations);

// Throws c10::Error naming what does not fit.
void CheckWindows(const std::vector<WindowRows>& groups, const ModelOptions& options);

class Refinement {
 public:
  // 'groups' are borrowed and must outlive it. REQUIRES: CheckWindows(groups, options), not empty.
  Refinement(const std::vector<WindowRows>& groups, const ModelOptions& options, torch::Device device);

  const torch::Tensor& positions() const { return positions_; }  // [N, S, 2] float32 feature pixels
  // [N, S, 3 * L * (2R+1)^2] float32 at the current estimates.
  torch::Tensor Correlations();
  // out [N, S, 2 or 3] float32: a step for every frame but the first and, perhaps, the visibility logit.
  void Advance(const torch::Tensor& out);
  // One a group, in their order.
  std::vector<WindowEstimate> Estimates(bool keep_templates) const;

 private:
  torch::Tensor FirstTemplates() const;
  torch::Tensor Sample() const;
  torch::Tensor Correlate(const torch::Tensor& templates) const;

  const std::vector<WindowRows>& groups_;
  const int64_t radius_;
  FeatureViews views_;                // CPU
  std::vector<PyramidCells> joined_;  // other devices: one a group
  std::vector<int64_t> rows_;         // of each group
  torch::Tensor feature_;             // [N, S, C] float32, f1 at every frame
  torch::Tensor positions_;
  torch::Tensor templates_;   // [N, S, 1 or 3, C] of the last iteration
  torch::Tensor last_step_;   // [N, S]
  torch::Tensor visibility_;  // [N, S]; undefined without a head
  bool started_ = false;
};

}  // namespace holdfast
