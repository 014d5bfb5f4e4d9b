// SPDX-License-Identifier: Apache-2.0
// The object prior: a prediction that has left its object pays its distance once more (eq. 1).
#pragma once

#include <torch/types.h>

#include "training/loss/clip_targets.h"

namespace holdfast {

constexpr int32_t kOutsideFrame = -1;

// masks [S, H, W] int32, positions [N, S, 2] float32 image pixels -> [N, S] int32: the id under the nearest pixel, or
// kOutsideFrame (positions that are not finite too).
torch::Tensor ObjectIds(const torch::Tensor& masks, const torch::Tensor& positions);

// The indicator of eq. 1: [N, S] bool, true where the prediction [N, S, 2] lies on another object than the ground
// truth, or outside the frame. Counts only where the truth is visible and both lie on labelled pixels. No gradient.
// REQUIRES: targets.masks is defined.
torch::Tensor LeftObject(const torch::Tensor& prediction, const ClipTargets& targets);

// Mean over all valid (point, frame) pairs of indicator * L1 distance in image pixels; 0 without masks. A scalar.
torch::Tensor ObjectnessLoss(const torch::Tensor& prediction, const ClipTargets& targets);

}  // namespace holdfast
