// SPDX-License-Identifier: Apache-2.0
// Published PIPs++ checkpoints (torch.save zips) into our own format.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "model/options.h"
#include "model/torch_import/torch_archive.h"

namespace holdfast {

// What the shapes of parameters do not tell.
struct ImportOptions {
  torch::ScalarType dtype = torch::kFloat32;  // of the storage: kFloat32, kFloat16 or kBFloat16
  int64_t context_heads = 8;                  // used where there is a contextual attention
  int64_t context_patch = 7;
  int64_t window = 24;
};

struct ImportResult {
  ModelOptions options;
  int64_t parameters = 0;
};

// The options of the network whose parameters have these shapes. INVALID_ARGUMENT names the parameter that is missing
// or fits no network. Parameters that the options do not depend on are not looked at.
absl::StatusOr<ModelOptions> InferModelOptions(const StateDict& tensors, const ImportOptions& import);

// Reads 'in', checks every name and shape against the network inferred and writes 'out' atomically.
absl::StatusOr<ImportResult> ImportPth(const std::string& in, const std::string& out, const ImportOptions& import);

}  // namespace holdfast
