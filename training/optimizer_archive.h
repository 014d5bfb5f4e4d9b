// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/optim/optimizer.h>

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace holdfast {

// The state of an optimizer (moments, step counts) as bytes, and back into one over the same parameters in the same
// order.
absl::StatusOr<std::string> SaveOptimizer(const torch::optim::Optimizer& optimizer);
absl::Status LoadOptimizer(const std::string& bytes, torch::optim::Optimizer& optimizer);

}  // namespace holdfast
