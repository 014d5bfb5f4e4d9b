// SPDX-License-Identifier: Apache-2.0
#include "training/loss/objectness_loss.h"

namespace holdfast {

torch::Tensor ObjectIds(const torch::Tensor& masks, const torch::Tensor& positions) {
  const torch::Tensor xy = torch::round(positions.detach());
  const torch::Tensor x = xy.select(-1, 0), y = xy.select(-1, 1);
  const int64_t height = masks.size(1), width = masks.size(2);
  const torch::Tensor inside = (x >= 0) & (y >= 0) & (x < width) & (y < height);
  // Wild positions must not reach the conversion to integers.
  const torch::Tensor column = torch::where(inside, x, torch::zeros_like(x)).to(torch::kLong);
  const torch::Tensor row = torch::where(inside, y, torch::zeros_like(y)).to(torch::kLong);
  const torch::Tensor frame = torch::arange(masks.size(0), column.options()).expand_as(column);
  const torch::Tensor ids = masks.flatten().index_select(0, ((frame * height + row) * width + column).flatten());
  return ids.view_as(column).masked_fill(~inside, kOutsideFrame);
}

torch::Tensor LeftObject(const torch::Tensor& prediction, const ClipTargets& targets) {
  const torch::Tensor truth_id = ObjectIds(targets.masks, targets.tracks);
  const torch::Tensor id = ObjectIds(targets.masks, prediction);
  const torch::Tensor counts = targets.valid & targets.visible & (truth_id > 0) & (id != 0);
  return counts & (id != truth_id);
}

torch::Tensor ObjectnessLoss(const torch::Tensor& prediction, const ClipTargets& targets) {
  if (!targets.masks.defined()) return torch::zeros({}, prediction.options());
  const torch::Tensor distance = (prediction - targets.tracks).abs().sum(-1);
  const torch::Tensor left = LeftObject(prediction, targets);
  return distance.masked_fill(~left, 0).sum() / targets.valid.sum().clamp_min(1);
}

}  // namespace holdfast
