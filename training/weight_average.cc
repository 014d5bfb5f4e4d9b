// SPDX-License-Identifier: Apache-2.0
#include "training/weight_average.h"

#include <torch/utils.h>

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace holdfast {

WeightAverage::WeightAverage(const torch::nn::Module& network, double decay) : decay_(decay) {
  for (const auto& item : network.named_parameters()) tensors_[item.key()] = item.value().detach().clone();
}

void WeightAverage::Update(const torch::nn::Module& network) {
  torch::NoGradGuard no_grad;
  const double n = static_cast<double>(updates_++);
  const double keep = std::min(decay_, (1 + n) / (10 + n));
  for (const auto& item : network.named_parameters()) tensors_.at(item.key()).lerp_(item.value(), 1 - keep);
}

void WeightAverage::CopyTo(torch::nn::Module& network) const {
  torch::NoGradGuard no_grad;
  for (auto& item : network.named_parameters()) item.value().copy_(tensors_.at(item.key()));
}

absl::Status WeightAverage::Restore(const std::map<std::string, torch::Tensor>& tensors, int64_t updates) {
  torch::NoGradGuard no_grad;
  if (tensors.size() != tensors_.size()) return absl::InvalidArgumentError("the average is of another network");
  for (auto& [name, tensor] : tensors_) {
    const auto found = tensors.find(name);
    if (found == tensors.end() || found->second.sizes() != tensor.sizes()) {
      return absl::InvalidArgumentError(absl::StrCat("the average has no fitting '", name, "'"));
    }
    tensor.copy_(found->second);
  }
  updates_ = updates;
  return absl::OkStatus();
}

}  // namespace holdfast
