// SPDX-License-Identifier: Apache-2.0
// Bilinear resizing, corners on corners, forward and backward, in channels-last memory.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

namespace holdfast {

// map [F, C, H, W] -> [F, C, height, width], of map's dtype; interpolated in float32 from places in float32. Float32
// and bfloat16 maps on the CPU come back channels-last. Other dtypes and devices take ATen's way, and never bfloat16 on
// the CPU: LibTorch 1.13 computes the places of such maps in bfloat16, and reads beyond their memory. Differentiable.
// Throws c10::Error unless the map has four dimensions and all sides are positive.
torch::Tensor ResizeBilinear(const torch::Tensor& map, int64_t height, int64_t width);

// Maps [F, C_i, H_i, W_i] of one F, resized likewise and joined -> [F, sum of C_i, height, width]; without a gradient
// each is written where it belongs.
torch::Tensor ResizeAndJoin(const std::vector<torch::Tensor>& maps, int64_t height, int64_t width);

}  // namespace holdfast
