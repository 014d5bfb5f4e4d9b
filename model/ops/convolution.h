// SPDX-License-Identifier: Apache-2.0
// The one way this network convolves: channels-last maps through oneDNN where it is there. Linear layers are 1x1
// convolutions of maps, since the BLAS behind at::linear is much slower than oneDNN on the CPU.
#pragma once

#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>

#include "model/ops/instance_norm.h"

namespace holdfast {

// x [N, C, H, W] channels-last in the dtype of the weights (any under autocast) -> [N, C', H', W'] channels-last.
// Padding is half of the kernel. Without a gradient the result of a map does not depend on the others of its batch.
torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv2d& conv);
// Kernel k over W of x [N, C, 1, W], zeros beyond the ends, W stays.
torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv1d& conv);
// conv(x) on the way to a norm, and conv(relu(norm(x))) on the way to another: where our kernel convolves, it takes the
// moments of what it writes, and norms what it reads.
MeasuredMap ConvolveMeasured(const torch::Tensor& x, const torch::nn::Conv2d& conv);
MeasuredMap ConvolveMeasured(const torch::Tensor& x, const torch::nn::Conv1d& conv);
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const torch::nn::Conv2d& conv);
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const torch::nn::Conv1d& conv);
// conv(relu(norm(x)))
torch::Tensor Convolve(const MeasuredMap& x, const torch::nn::Conv1d& conv);
// A linear layer at every pixel.
torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Linear& linear);
// The same in float32, whatever the dtype of the weights.
torch::Tensor ConvolveInFloat(const torch::Tensor& x, const torch::nn::Linear& linear);

// The weights in the memory order that the convolution wants; called once, by constructors.
void UseChannelsLast(torch::nn::Conv2d& conv);
void UseChannelsLast(torch::nn::Conv1d& conv);

}  // namespace holdfast
