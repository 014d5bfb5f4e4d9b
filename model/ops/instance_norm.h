// SPDX-License-Identifier: Apache-2.0
// Instance normalisation (no affine, eps 1e-5) fused with what follows it. Maps [N, C, H, W] float32 or bfloat16 in
// channels-last memory (others are converted); statistics in float32. A map's result depends neither on the batch nor
// on the number of threads. Differentiable; devices without a kernel take ATen's operations.
#pragma once

#include <torch/types.h>

namespace holdfast {

torch::Tensor InstanceNorm(const torch::Tensor& x);
// relu(norm(x))
torch::Tensor InstanceNormRelu(const torch::Tensor& x);
// relu(identity + relu(norm(x))): the end of a residual block of the encoder.
torch::Tensor InstanceNormReluAdd(const torch::Tensor& x, const torch::Tensor& identity);

// A map before its norm. What wrote it may have taken its moments on the way, and what reads it may norm it on the way.
struct MeasuredMap {
  torch::Tensor map;
  torch::Tensor moments;  // [N, 2, C] float32, mean and 1 / deviation; undefined: the norm takes them
};

// Takes the moments where a kernel of a convolution can use them: in float32 on the CPU without a gradient.
MeasuredMap Measure(const torch::Tensor& x);
torch::Tensor InstanceNormRelu(const MeasuredMap& x);
torch::Tensor InstanceNormReluAdd(const MeasuredMap& x, const torch::Tensor& identity);

}  // namespace holdfast
