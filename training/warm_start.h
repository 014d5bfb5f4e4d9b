// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/checkpoint/safetensors.h"
#include "model/point_model.h"

namespace holdfast {

struct WarmStartReport {
  int64_t copied = 0;               // parameters
  std::vector<std::string> padded;  // more outputs than the file has: the new ones start at nothing
  std::vector<std::string> fresh;   // not in the file or of another shape: as initialized
};

// Starts 'model' from the weights of a network with other options: every parameter that fits is copied. A last linear
// with more outputs takes the file's rows and zeros. Attention blocks the file does not have begin as the identity
// (their output projections are zero), and the norm after them, where the file has none, as near the identity as a norm
// can be, measured on 'frames' ([F, H, W, 3] uint8; undefined: not measured). So the start behaves as the network of
// the file does. INVALID_ARGUMENT: nothing fits.
absl::StatusOr<WarmStartReport> WarmStart(const TensorFile& file, const torch::Tensor& frames, PointModelImpl& model);

}  // namespace holdfast
