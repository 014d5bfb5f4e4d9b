// SPDX-License-Identifier: Apache-2.0
// The device that the network computes on.
#pragma once

#include <c10/core/Device.h>

#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

// The device of this name, as LibTorch names it ("cpu", "cuda:1"), tried out; INVALID_ARGUMENT where there is none.
// From then on the process computes float32 in full: LibTorch lets NVIDIA's libraries round factors to TF32, which has
// nineteen bits, unless it is told otherwise.
absl::StatusOr<c10::Device> OpenDevice(const std::string& name);

// Returns when the device has done what this thread has asked of it, which a GPU does later.
void AwaitDevice(const c10::Device& device);

}  // namespace holdfast
