// SPDX-License-Identifier: Apache-2.0
// The one way this network convolves: channels-last maps through oneDNN where it is there. Linear layers are 1x1
// convolutions of maps, since the BLAS behind at::linear is much slower than oneDNN on the CPU.
#pragma once

#include <torch/nn/modules/conv.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>

#include <cstdint>
#include <tuple>

#include "model/ops/instance_norm.h"

namespace holdfast {

// A layer over time. Its weights lie in memory as the convolution wants them.
class Conv1dImpl : public torch::nn::Conv1dImpl {
 public:
  explicit Conv1dImpl(const torch::nn::Conv1dOptions& options);
  // Keeps the weights as our kernel reads them too, until they change; does nothing where another one convolves. Not
  // while anybody convolves.
  void PackWeights();
  // Undefined: there are none of the weights as they are.
  torch::Tensor packed() const;

 private:
  // Where weight and bias lie, and how often each was written.
  using Stamp = std::tuple<const void*, int64_t, const void*, int64_t>;
  Stamp stamp() const { return {weight.data_ptr(), weight._version(), bias.data_ptr(), bias._version()}; }

  torch::Tensor packed_;
  Stamp packed_of_;
};
TORCH_MODULE(Conv1d);

// All such layers of a network that is to infer.
void PackWeights(torch::nn::Module& network);

// x [N, C, H, W] channels-last in the dtype of the weights (any under autocast) -> [N, C', H', W'] channels-last.
// Padding is half of the kernel. Without a gradient the result of a map does not depend on the others of its batch.
torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Conv2d& conv);
// Kernel k over W of x [N, C, 1, W], zeros beyond the ends, W stays.
torch::Tensor Convolve(const torch::Tensor& x, const Conv1d& conv);
// conv(x) on the way to a norm, and conv(relu(norm(x))) on the way to another: where our kernel convolves, it takes the
// moments of what it writes, and norms what it reads.
MeasuredMap ConvolveMeasured(const torch::Tensor& x, const torch::nn::Conv2d& conv);
MeasuredMap ConvolveMeasured(const torch::Tensor& x, const Conv1d& conv);
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const torch::nn::Conv2d& conv);
MeasuredMap ConvolveMeasured(const MeasuredMap& x, const Conv1d& conv);
// conv(relu(norm(x)))
torch::Tensor Convolve(const MeasuredMap& x, const Conv1d& conv);
// A linear layer at every pixel.
torch::Tensor Convolve(const torch::Tensor& x, const torch::nn::Linear& linear);
// The same in float32, whatever the dtype of the weights.
torch::Tensor ConvolveInFloat(const torch::Tensor& x, const torch::nn::Linear& linear);

// The weights in the memory order that the convolution wants; called once, by constructors.
void UseChannelsLast(torch::nn::Conv2d& conv);

}  // namespace holdfast
