// SPDX-License-Identifier: Apache-2.0
// Which precision the network runs in where nobody said.
#pragma once

#include <c10/core/Device.h>

namespace holdfast {

// Whether 'device' computes convolutions faster in bfloat16 than in float32. On a CPU that is so when oneDNN, which
// LibTorch convolves with, has the processor's bfloat16 products to use: the processor must have them, and the
// environment variable ONEDNN_MAX_CPU_ISA (or DNNL_MAX_CPU_ISA) must not hide them. The first call fixes oneDNN's
// choice for the life of the process. A GPU has such products from compute capability 8.0 on, and LibTorch uses them
// where it was built with cuDNN.
bool ComputesBFloat16Faster(const c10::Device& device);

}  // namespace holdfast
