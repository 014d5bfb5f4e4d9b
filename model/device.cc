// SPDX-License-Identifier: Apache-2.0
#include "model/device.h"

#include <ATen/Context.h>
#include <c10/core/Stream.h>
#include <c10/core/impl/VirtualGuardImpl.h>
#include <torch/types.h>

#include <exception>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace holdfast {

absl::StatusOr<c10::Device> OpenDevice(const std::string& name) {
  at::globalContext().setAllowTF32CuDNN(false);
  at::globalContext().setAllowTF32CuBLAS(false);
  try {
    const c10::Device device(name);
    torch::empty({1}, device);
    return device;
  } catch (const std::exception&) {
    return absl::InvalidArgumentError(absl::StrCat("there is no device '", name, "'"));
  }
}

void AwaitDevice(const c10::Device& device) {
  if (device.is_cpu()) return;
  const c10::impl::VirtualGuardImpl impl(device.type());
  impl.synchronizeStream(impl.getStream(device));
}

}  // namespace holdfast
