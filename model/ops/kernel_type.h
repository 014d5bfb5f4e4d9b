// SPDX-License-Identifier: Apache-2.0
// Between tensors and the CPU kernels' element types.
#pragma once

#include <torch/types.h>

#include "model/kernels/simd.h"

namespace holdfast {

// Kernels exist for float32 and bfloat16 on the CPU.
inline bool HasKernel(const torch::Tensor& x) {
  return x.device().is_cpu() && (x.scalar_type() == torch::kFloat32 || x.scalar_type() == torch::kBFloat16);
}

template <typename T>
T* KernelData(const torch::Tensor& x) {
  return static_cast<T*>(x.data_ptr());
}

}  // namespace holdfast
