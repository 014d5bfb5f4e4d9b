// SPDX-License-Identifier: Apache-2.0
#include "training/working_network.h"

#include <torch/utils.h>

namespace holdfast {

WorkingNetwork::WorkingNetwork(PointModel master, torch::ScalarType dtype, bool copy)
    : master_(master), working_(master), is_copy_(copy || dtype != torch::kFloat32) {
  if (!is_copy_) return;
  working_ = PointModel(master->options());
  working_->to(master->parameters().front().device(), dtype);
  Refresh();
}

void WorkingNetwork::Refresh() {
  if (!is_copy_) return;
  torch::NoGradGuard no_grad;
  const std::vector<torch::Tensor> from = master_->parameters(), to = working_->parameters();
  for (size_t i = 0; i < to.size(); ++i) to[i].copy_(from[i]);
}

void WorkingNetwork::CollectGradients() {
  if (!is_copy_) return;
  torch::NoGradGuard no_grad;
  std::vector<torch::Tensor> to = master_->parameters(), from = working_->parameters();
  for (size_t i = 0; i < to.size(); ++i) {
    torch::Tensor& gradient = from[i].mutable_grad();
    if (!gradient.defined()) continue;
    if (to[i].grad().defined()) {
      to[i].mutable_grad().add_(gradient);
    } else {
      to[i].mutable_grad() = gradient.to(torch::kFloat32);
    }
    gradient = torch::Tensor();
  }
}

}  // namespace holdfast
