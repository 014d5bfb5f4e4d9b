// SPDX-License-Identifier: Apache-2.0
// The gradient of all parameters as one vector: what processes exchange, the guard looks at and clipping shortens.
#pragma once

#include <torch/types.h>

#include <vector>

#include "absl/status/status.h"
#include "training/distributed.h"

namespace holdfast {

// Adds up, over all processes, the gradients of 'parameters' and the 'extra' numbers that travel with them, in one
// exchange; then multiplies the gradients by 'scale'. Every parameter's gradient becomes a view into the result [n],
// except where it was not defined: such a parameter takes no part.
absl::StatusOr<torch::Tensor> SumGradients(const std::vector<torch::Tensor>& parameters, double scale,
                                           ProcessGroup& group, std::vector<double>& extra);

// Leaves every gradient undefined, ready for the next step's.
void ClearGradients(const std::vector<torch::Tensor>& parameters);

// Shortens 'gradient' to 'max_norm' in place; returns the norm before.
double ClipGradient(torch::Tensor& gradient, double max_norm);

}  // namespace holdfast
