// SPDX-License-Identifier: Apache-2.0
// Gradients of a function against those of a plain formula, both by autograd, on float32 tensors.
#pragma once

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <functional>
#include <vector>

namespace holdfast {

using TensorFunction = std::function<torch::Tensor(const std::vector<torch::Tensor>&)>;

// Largest absolute difference relative to the largest absolute value wanted.
inline double RelativeDifference(const torch::Tensor& got, const torch::Tensor& want) {
  EXPECT_EQ(got.sizes(), want.sizes());
  const torch::Tensor wide = want.to(torch::kDouble);
  const double scale = std::max(1e-12, wide.abs().max().item<double>());
  return (got.to(torch::kDouble) - wide).abs().max().item<double>() / scale;
}

inline torch::Tensor Weights(const torch::Tensor& phase) {
  return torch::sin(phase * 12.9898).to(torch::kBFloat16).to(torch::kDouble);
}

struct FunctionResult {
  torch::Tensor value;
  std::vector<torch::Tensor> gradients;  // of sum(value * weights) by each input
};

// 'inputs' converted to 'dtype'; the weights are the same pseudo-random numbers each time, and bfloat16 holds them, so
// that what flows back is not rounded before it reaches the function.
inline FunctionResult Differentiate(const TensorFunction& function, const std::vector<torch::Tensor>& inputs,
                                    torch::ScalarType dtype) {
  std::vector<torch::Tensor> leaves;
  leaves.reserve(inputs.size());
  for (const auto& input : inputs) leaves.push_back(input.detach().to(dtype).clone().requires_grad_());
  FunctionResult result;
  result.value = function(leaves);
  const torch::Tensor phase = torch::arange(result.value.numel(), torch::kDouble).view(result.value.sizes());
  (result.value.to(torch::kDouble) * Weights(phase)).sum().backward();
  for (const auto& leaf : leaves) result.gradients.push_back(leaf.grad());
  return result;
}

// Value and gradients of 'function' in 'dtype' equal those of 'plain' in double.
inline void ExpectSameGradients(const TensorFunction& function, const TensorFunction& plain,
                                const std::vector<torch::Tensor>& inputs, double tolerance,
                                torch::ScalarType dtype = torch::kFloat32) {
  std::vector<torch::Tensor> rounded;
  rounded.reserve(inputs.size());
  for (const auto& input : inputs) rounded.push_back(input.to(dtype));
  const FunctionResult got = Differentiate(function, rounded, dtype);
  const FunctionResult want = Differentiate(plain, rounded, torch::kDouble);
  EXPECT_LE(RelativeDifference(got.value, want.value), tolerance);
  for (size_t i = 0; i < inputs.size(); ++i) {
    ASSERT_TRUE(got.gradients[i].defined()) << "input " << i;
    EXPECT_LE(RelativeDifference(got.gradients[i], want.gradients[i]), tolerance) << "input " << i;
  }
}

// Gradients of 'function' in double equal central differences of its values.
inline void ExpectDifferentiable(const TensorFunction& function, const std::vector<torch::Tensor>& inputs) {
  const FunctionResult result = Differentiate(function, inputs, torch::kDouble);
  const torch::Tensor phase = torch::arange(result.value.numel(), torch::kDouble).view(result.value.sizes());
  const auto weighted = [&](const std::vector<torch::Tensor>& at) {
    return (function(at) * Weights(phase)).sum().item<double>();
  };
  constexpr double kStep = 1e-5;
  const torch::NoGradGuard no_grad;
  for (size_t i = 0; i < inputs.size(); ++i) {
    for (int64_t j = 0; j < inputs[i].numel(); j += std::max<int64_t>(1, inputs[i].numel() / 20)) {
      std::vector<torch::Tensor> at;
      at.reserve(inputs.size());
      for (const auto& input : inputs) at.push_back(input.to(torch::kDouble).clone(torch::MemoryFormat::Contiguous));
      at[i].view(-1)[j] += kStep;
      const double above = weighted(at);
      at[i].view(-1)[j] -= 2 * kStep;
      const double slope = (above - weighted(at)) / (2 * kStep);
      EXPECT_NEAR(result.gradients[i].reshape(-1)[j].item<double>(), slope, 1e-5 * std::max(1.0, std::abs(slope)));
    }
  }
}

}  // namespace holdfast
