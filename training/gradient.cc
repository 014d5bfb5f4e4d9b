// SPDX-License-Identifier: Apache-2.0
#include "training/gradient.h"

#include <torch/utils.h>

#include <algorithm>

namespace holdfast {

absl::StatusOr<torch::Tensor> SumGradients(const std::vector<torch::Tensor>& parameters, double scale,
                                           ProcessGroup& group, std::vector<double>& extra) {
  torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> pieces;
  for (const torch::Tensor& parameter : parameters) {
    if (parameter.grad().defined()) pieces.push_back(parameter.grad().flatten());
  }
  const torch::Device device = parameters.front().device();
  pieces.push_back(torch::tensor(extra, torch::kFloat32).to(device));
  torch::Tensor all = torch::cat(pieces);
  const absl::Status status = group.Sum(all);
  if (!status.ok()) return status;
  const int64_t count = all.numel() - static_cast<int64_t>(extra.size());
  const torch::Tensor numbers = all.narrow(0, count, all.numel() - count).to(torch::kCPU, torch::kFloat64);
  std::copy_n(numbers.data_ptr<double>(), extra.size(), extra.begin());
  torch::Tensor gradient = all.narrow(0, 0, count).mul_(scale);
  int64_t offset = 0;
  for (const torch::Tensor& parameter : parameters) {
    if (!parameter.grad().defined()) continue;
    parameter.mutable_grad() = gradient.narrow(0, offset, parameter.numel()).view(parameter.sizes());
    offset += parameter.numel();
  }
  return gradient;
}

void ClearGradients(const std::vector<torch::Tensor>& parameters) {
  for (const torch::Tensor& parameter : parameters) parameter.mutable_grad() = torch::Tensor();
}

double ClipGradient(torch::Tensor& gradient, double max_norm) {
  const double norm = gradient.norm().item<double>();
  if (norm > max_norm) gradient.mul_(max_norm / norm);
  return norm;
}

}  // namespace holdfast
