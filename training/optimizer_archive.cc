// SPDX-License-Identifier: Apache-2.0
#include "training/optimizer_archive.h"

#include <torch/serialize/archive.h>

#include <exception>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "training/first_line.h"

namespace holdfast {

absl::StatusOr<std::string> SaveOptimizer(const torch::optim::Optimizer& optimizer) {
  try {
    torch::serialize::OutputArchive archive;
    optimizer.save(archive);
    std::ostringstream bytes;
    archive.save_to(bytes);
    return bytes.str();
  } catch (const std::exception& e) {
    return absl::InternalError(absl::StrCat("cannot archive the optimizer: ", FirstLine(e)));
  }
}

absl::Status LoadOptimizer(const std::string& bytes, torch::optim::Optimizer& optimizer) {
  try {
    torch::serialize::InputArchive archive;
    // By itself it would put tensors on the device they were saved from, which may be another one or not there.
    archive.load_from(bytes.data(), bytes.size(), optimizer.param_groups().at(0).params().at(0).device());
    optimizer.load(archive);
    return absl::OkStatus();
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("the optimizer's state does not load: ", FirstLine(e)));
  }
}

}  // namespace holdfast
