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

  // What goes on is done for the M rows that move still: all N of them, until Settle is called.
  torch::Tensor positions() const { return Moving(positions_); }  // [M, S, 2] float32 feature pixels
  // [M, S, 3 * L * (2R+1)^2] float32 at the current estimates.
  torch::Tensor Correlations();
  // out [M, S, 2 or 3] float32: a step for every frame but the first and, perhaps, the visibility logit.
  void Advance(const torch::Tensor& out);
  // Rows whose last step was shorter than 'least' feature pixels on every frame stay as they are from now on. A row is
  // judged by itself alone. False: none moves any more.
  bool Settle(double least);
  // One a group, in their order. Templates are kept only where no row has settled. Ends the refinement.
  std::vector<WindowEstimate> Estimates(bool keep_templates);

 private:
  torch::Tensor FirstTemplates() const;
  torch::Tensor Sample() const;
  torch::Tensor Correlate(const torch::Tensor& templates) const;
  // From [N, ...] to [M, ...], and back again.
  torch::Tensor Moving(const torch::Tensor& all) const;
  void Set(torch::Tensor& all, const torch::Tensor& moving) const;
  void LookAt(const torch::Tensor& rows);

  const std::vector<WindowRows>& groups_;
  const int64_t radius_;
  FeatureViews views_;                // CPU
  std::vector<PyramidCells> joined_;  // other devices: one a group
  std::vector<int64_t> rows_;         // of each group that are looked at
  torch::Tensor group_of_row_;        // [N] int64, CPU
  torch::Tensor moving_;              // [M] int64, rows in rising order; undefined: all of them
  torch::Tensor feature_;             // [N, S, C] float32, f1 at every frame
  torch::Tensor positions_;
  torch::Tensor templates_;   // [M, S, 1 or 3, C] of the last iteration
  torch::Tensor last_step_;   // [N, S]
  torch::Tensor iterations_;  // [N] int64
  torch::Tensor visibility_;  // [N, S]; undefined without a head
  bool started_ = false;
};

}  // namespace holdfast
