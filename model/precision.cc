// SPDX-License-Identifier: Apache-2.0
#include "model/precision.h"

#include <ATen/Context.h>
#include <c10/core/DeviceGuard.h>
#include <oneapi/dnnl/dnnl.h>

namespace holdfast {

bool ComputesBFloat16Faster(const c10::Device& device) {
  if (device.is_cuda() && at::hasCUDA()) {
    c10::OptionalDeviceGuard guard;
    if (device.has_index()) guard.reset_device(device);
    // Of compute capability 8.0 or more.
    return at::detail::getCUDAHooks().supportsBFloat16ConvolutionWithCuDNNv8();
  }
  if (!device.is_cpu()) return false;
#if defined(__x86_64__)
  // An instruction set's number has a bit for each set that it contains.
  return (dnnl_get_effective_cpu_isa() & dnnl_cpu_isa_avx512_core_bf16) == dnnl_cpu_isa_avx512_core_bf16;
#else
  return false;
#endif
}

}  // namespace holdfast
