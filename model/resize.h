// SPDX-License-Identifier: Apache-2.0
// Bilinear resizing, corners on corners, with a backward pass that keeps maps channels-last.
#pragma once

#include <torch/types.h>

namespace holdfast {

// map [F, C, H, W] channels-last, float32 or bfloat16 -> [F, C, height, width] channels-last. Differentiable; other
// dtypes and devices take ATen's way.
torch::Tensor ResizeBilinear(const torch::Tensor& map, int64_t height, int64_t width);

}  // namespace holdfast
