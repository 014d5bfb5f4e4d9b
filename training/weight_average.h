// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>

#include <map>
#include <string>

#include "absl/status/status.h"

namespace holdfast {

// The exponential moving average of a network's weights: smoother than the weights themselves, so it is what is
// validated and shipped. Not thread-safe.
class WeightAverage {
 public:
  // Starts at the weights as they are. 'decay' in [0, 1); 0: always equals the weights. Early updates decay faster, so
  // that the start is forgotten: min(decay, (1 + n) / (10 + n)) at update n.
  WeightAverage(const torch::nn::Module& network, double decay);

  void Update(const torch::nn::Module& network);
  // Overwrites the weights of 'network', of the same architecture.
  void CopyTo(torch::nn::Module& network) const;

  const std::map<std::string, torch::Tensor>& tensors() const { return tensors_; }
  int64_t updates() const { return updates_; }
  // Goes on from a saved average. INVALID_ARGUMENT: names or shapes differ.
  absl::Status Restore(const std::map<std::string, torch::Tensor>& tensors, int64_t updates);

 private:
  double decay_;
  int64_t updates_ = 0;
  std::map<std::string, torch::Tensor> tensors_;  // by parameter name, float32
};

}  // namespace holdfast
