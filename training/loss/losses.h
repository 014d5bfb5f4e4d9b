// SPDX-License-Identifier: Apache-2.0
// What a clip costs: distance over all iterations (eq. 2), object prior (eq. 1), visibility, and, if asked for,
// matching.
#pragma once

#include <torch/types.h>

#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "training/loss/clip_targets.h"
#include "training/report/training_report.h"

namespace holdfast {

enum class DistanceForm {
  kPaper,      // L1 over the two coordinates, summed over iterations
  kPublished,  // as the published code: mean over the two coordinates, divided by the number of iterations
};

// As flags and descriptions have it: "paper", "published". Found by the library of flags.
bool AbslParseFlag(absl::string_view text, DistanceForm* form, std::string* error);
std::string AbslUnparseFlag(DistanceForm form);

// What each may be is a matter of the recipe (training/recipe_fields.inc).
struct LossOptions {
  DistanceForm form = DistanceForm::kPaper;
  double gamma = 0.8;               // weight of an iteration relative to the one after it
  double alpha = 0.15;              // weight of the objectness loss; 0: without
  double visibility_weight = 0.05;  // of the cross-entropy of the visibility logits, for networks that give them
  double matching_weight = 0;       // of the matching loss; 0: without
};

// What the network said about a clip. Positions are image pixels and not locked at frame 0.
struct Prediction {
  std::vector<torch::Tensor> positions;  // K x [N, S, 2] float32, after each iteration
  torch::Tensor visibility_logit;        // [N, S] of the last iteration; undefined: the network has no such output
  torch::Tensor maps;                    // [S, C, H8, W8]; needed for the matching loss only
  int64_t stride = 8;                    // image pixels a cell of 'maps'
};

// Scalars. 'total' carries the gradient; the parts are before weighting, detached; undefined where not asked for.
using LossParts = LossPartsOf<torch::Tensor>;

// Every valid (point, frame) pair counts the same; pairs whose label is not valid count nowhere.
torch::Tensor DistanceLoss(const std::vector<torch::Tensor>& positions, const ClipTargets& targets,
                           const LossOptions& options);
// Binary cross-entropy of logits [N, S] over the valid pairs.
torch::Tensor VisibilityLoss(const torch::Tensor& logit, const ClipTargets& targets);
// distance + alpha * objectness (eq. 3) + the weighted rest.
LossParts ClipLoss(const Prediction& prediction, const ClipTargets& targets, const LossOptions& options);

}  // namespace holdfast
