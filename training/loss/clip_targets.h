// SPDX-License-Identifier: Apache-2.0
// A clip as tensors: what the network takes and what the losses compare with.
#pragma once

#include <torch/types.h>

#include "absl/status/statusor.h"
#include "training/data/sample.h"

namespace holdfast {

// Ground truth of N points on S frames of H x W pixels. All tensors are on one device.
struct ClipTargets {
  torch::Tensor tracks;   // [N, S, 2] float32, image pixels (x, y)
  torch::Tensor visible;  // [N, S] bool; true implies valid and inside the frame
  torch::Tensor valid;    // [N, S] bool: the label can be trusted
  torch::Tensor masks;    // [S, H, W] int32 object ids, 0: unlabelled; undefined: the source has no masks
};

struct ClipTensors {
  torch::Tensor frames;  // [S, H, W, 3] uint8 RGB
  ClipTargets targets;

  ClipTensors To(const torch::Device& device) const;
};

// Copies. INVALID_ARGUMENT: no points, or a frame whose sides are no multiples of 'stride'.
absl::StatusOr<ClipTensors> ToTensors(const Sample& sample, int64_t stride);

}  // namespace holdfast
