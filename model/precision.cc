// SPDX-License-Identifier: Apache-2.0
#include "model/precision.h"

#include <oneapi/dnnl/dnnl.h>

namespace holdfast {

bool ComputesBFloat16Faster(const c10::Device& device) {
  if (!device.is_cpu()) return device.is_cuda();
#if defined(__x86_64__)
  // An instruction set's number has a bit for each set that it contains.
  return (dnnl_get_effective_cpu_isa() & dnnl_cpu_isa_avx512_core_bf16) == dnnl_cpu_isa_avx512_core_bf16;
#else
  return false;
#endif
}

}  // namespace holdfast
