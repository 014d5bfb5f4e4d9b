// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

namespace holdfast {

// Whether LibTorch convolves bfloat16 on this processor by oneDNN, which takes AVX-512. Without it a loop of its own
// rounds at every step and takes minutes for what takes a second; nobody computes so who was not told to
// (ComputesBFloat16Faster), and the bounds of tests do not hold for it.
inline bool HasBFloat16Convolutions() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
#else
  return false;
#endif
}

// In a test, or before one in SetUp.
#define SKIP_WITHOUT_BFLOAT16_CONVOLUTIONS() \
  if (!HasBFloat16Convolutions()) GTEST_SKIP() << "the processor has no AVX-512: nobody computes in bfloat16 here"

}  // namespace holdfast
