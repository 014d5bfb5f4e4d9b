// SPDX-License-Identifier: Apache-2.0
// softmax(Q V^T / sqrt(D)) V for the tokens of each M x M patch over those of its 3 x 3 neighbour patches.
#pragma once

#include <torch/types.h>

namespace holdfast {

struct AttentionShape {
  int64_t heads = 1;
  int64_t patch = 7;  // M, tokens
};

// query, value [F, H, W, C] of one dtype -> the same shape and dtype. Differentiable, any device.
torch::Tensor PatchAttention(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape);
// The same in ATen operations only: the way of devices without a kernel.
torch::Tensor PatchAttentionPlain(const torch::Tensor& query, const torch::Tensor& value, const AttentionShape& shape);

}  // namespace holdfast
