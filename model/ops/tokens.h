// SPDX-License-Identifier: Apache-2.0
// What a transformer does to each token by itself. In float32 at least, whatever the dtype; differentiable, any device.
#pragma once

#include <torch/nn/modules/normalization.h>
#include <torch/types.h>

namespace holdfast {

// Layer norm over the channels of each pixel: map [F, C, H, W] -> the same in the dtype of the weights, channels-last.
torch::Tensor NormChannels(const torch::Tensor& map, const torch::nn::LayerNorm& norm);

// x / 2 * (1 + erf(x / sqrt 2)), x [F, C, H, W] channels-last. Without a gradient x is overwritten.
torch::Tensor Gelu(const torch::Tensor& x);

}  // namespace holdfast
