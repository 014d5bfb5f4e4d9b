// SPDX-License-Identifier: Apache-2.0
#include "training/loss/losses.h"

#include <torch/nn/functional/loss.h>

#include "training/loss/matching_loss.h"
#include "training/loss/objectness_loss.h"

namespace holdfast {
namespace {

torch::Tensor MeanOver(const torch::Tensor& values, const torch::Tensor& counts) {
  return values.masked_fill(~counts, 0).sum() / counts.sum().clamp_min(1);
}

}  // namespace

bool AbslParseFlag(absl::string_view text, DistanceForm* form, std::string* error) {
  for (const DistanceForm known : {DistanceForm::kPaper, DistanceForm::kPublished}) {
    if (text != AbslUnparseFlag(known)) continue;
    *form = known;
    return true;
  }
  *error = "expected paper or published";
  return false;
}

std::string AbslUnparseFlag(DistanceForm form) { return form == DistanceForm::kPaper ? "paper" : "published"; }

torch::Tensor DistanceLoss(const std::vector<torch::Tensor>& positions, const ClipTargets& targets,
                           const LossOptions& options) {
  torch::Tensor sum = torch::zeros({}, targets.tracks.options());
  for (const torch::Tensor& position : positions) {
    sum = sum * options.gamma + MeanOver((position - targets.tracks).abs().sum(-1), targets.valid);
  }
  if (options.form == DistanceForm::kPaper) return sum;
  return sum / (2.0 * static_cast<double>(positions.size()));
}

torch::Tensor VisibilityLoss(const torch::Tensor& logit, const ClipTargets& targets) {
  namespace F = torch::nn::functional;
  const torch::Tensor entropy =
      F::binary_cross_entropy_with_logits(logit, targets.visible.to(logit.scalar_type()),
                                          F::BinaryCrossEntropyWithLogitsFuncOptions().reduction(torch::kNone));
  return MeanOver(entropy, targets.valid);
}

LossParts ClipLoss(const Prediction& prediction, const ClipTargets& targets, const LossOptions& options) {
  LossParts parts;
  parts.distance = DistanceLoss(prediction.positions, targets, options);
  parts.total = parts.distance;
  const auto add = [&](torch::Tensor& part, const torch::Tensor& loss, double weight) {
    parts.total = parts.total + weight * loss;
    part = loss.detach();
  };
  if (options.alpha > 0) {
    const double scale = options.form == DistanceForm::kPublished ? 0.5 : 1.0;  // the mean over coordinates here too
    add(parts.objectness, scale * ObjectnessLoss(prediction.positions.back(), targets), options.alpha);
  }
  if (prediction.visibility_logit.defined() && options.visibility_weight > 0) {
    add(parts.visibility, VisibilityLoss(prediction.visibility_logit, targets), options.visibility_weight);
  }
  if (options.matching_weight > 0) {
    add(parts.matching, MatchingLoss(prediction.maps, targets, prediction.stride), options.matching_weight);
  }
  parts.distance = parts.distance.detach();
  return parts;
}

}  // namespace holdfast
