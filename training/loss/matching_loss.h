// SPDX-License-Identifier: Apache-2.0
// Teaches the encoder directly: the template of a query should match the map of every frame best where the point is.
#pragma once

#include <torch/types.h>

#include "training/loss/clip_targets.h"

namespace holdfast {

// The four cells around positions on a map of height x width cells, and their bilinear weights.
struct BilinearCells {
  torch::Tensor index;   // [..., 4] int64, y * width + x
  torch::Tensor weight;  // [..., 4] float32, sums to 1
};
// positions [..., 2] float32 in cells; those outside are clamped to the map's edge.
BilinearCells CellsAround(const torch::Tensor& positions, int64_t height, int64_t width);

// Cross-entropy of the softmax over the cells of <f1, F_t> / sqrt(C) against the true cell, bilinearly spread; mean
// over the visible (point, frame) pairs. maps [S, C, H8, W8]; f1 is sampled from frame 0. A scalar, in nats.
torch::Tensor MatchingLoss(const torch::Tensor& maps, const ClipTargets& targets, int64_t stride);

}  // namespace holdfast
