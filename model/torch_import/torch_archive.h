// SPDX-License-Identifier: Apache-2.0
// The zip file that torch.save writes: a pickle of the structure and one stored entry a storage.
#pragma once

#include <torch/types.h>

#include <map>
#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

using StateDict = std::map<std::string, torch::Tensor>;  // contiguous, CPU

// The dict under "model_state_dict", or the whole file if it is a state dict itself. A leading "module." is taken off
// the names. No code of the file is run. INVALID_ARGUMENT says what is wrong: no torch.save zip, a pickle that refers
// to anything but tensors, a tensor outside its storage, a truncated or compressed entry, a value that is no tensor.
absl::StatusOr<StateDict> ReadTorchStateDict(const std::string& path);

}  // namespace holdfast
