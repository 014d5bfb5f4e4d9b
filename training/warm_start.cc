// SPDX-License-Identifier: Apache-2.0
#include "training/warm_start.h"

#include <torch/utils.h>

#include <exception>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "training/first_line.h"

namespace holdfast {
namespace {

bool HasAttention(const TensorFile& file) {
  for (const auto& item : file.tensors) {
    if (absl::StartsWith(item.first, "context.")) return true;
  }
  return false;
}

bool SameButRows(const torch::Tensor& parameter, const torch::Tensor& given) {
  return parameter.dim() == given.dim() && parameter.dim() > 0 && given.size(0) < parameter.size(0) &&
         parameter.sizes().slice(1) == given.sizes().slice(1);
}

void CopyFitting(const TensorFile& file, PointModelImpl& model, WarmStartReport& report) {
  for (auto& item : model.named_parameters()) {
    const std::string& name = item.key();
    torch::Tensor parameter = item.value();
    const auto given = file.tensors.find(name);
    if (given != file.tensors.end() && given->second.sizes() == parameter.sizes()) {
      parameter.copy_(given->second);
      ++report.copied;
    } else if (given != file.tensors.end() && absl::StartsWith(name, "delta_block.dense.") &&
               SameButRows(parameter, given->second)) {
      parameter.zero_().narrow(0, 0, given->second.size(0)).copy_(given->second);
      report.padded.push_back(name);
    } else {
      report.fresh.push_back(name);
    }
  }
}

// Each part of an attention block is added to what it gets, so that one whose last linear is zero changes nothing.
void ZeroFreshOutputs(const std::vector<std::string>& fresh, PointModelImpl& model) {
  auto parameters = model.named_parameters();
  for (const std::string& name : fresh) {
    if (!absl::StartsWith(name, "context.blocks.")) continue;
    if (absl::StrContains(name, ".proj.") || absl::StrContains(name, ".fc2.")) parameters[name].zero_();
  }
}

// The last norm divides each token by its own deviation and takes its mean away; the mean of both over 'frames' undoes
// that but for how tokens differ from each other.
void MatchLastNorm(const torch::Tensor& frames, PointModelImpl& model) {
  ModelOptions plain = model.options();
  plain.context_blocks = 0;
  PointModel encoder(plain);
  auto parameters = model.named_parameters();
  for (auto& item : encoder->named_parameters()) item.value().copy_(parameters[item.key()]);
  const torch::Tensor tokens = encoder->Encode(frames).to(torch::kFloat32);  // [F, C, H8, W8]
  parameters["context.norm.weight"].fill_(tokens.std(1, false).mean());
  parameters["context.norm.bias"].fill_(tokens.mean());
}

}  // namespace

absl::StatusOr<WarmStartReport> WarmStart(const TensorFile& file, const torch::Tensor& frames, PointModelImpl& model) {
  torch::NoGradGuard no_grad;
  WarmStartReport report;
  CopyFitting(file, model, report);
  if (report.copied == 0) return absl::InvalidArgumentError("no parameter of the file fits the network");
  ZeroFreshOutputs(report.fresh, model);
  if (model.options().context_blocks == 0 || HasAttention(file) || !frames.defined()) return report;
  try {
    MatchLastNorm(frames, model);
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("cannot run the network on the given frames: ", FirstLine(e)));
  }
  return report;
}

}  // namespace holdfast
