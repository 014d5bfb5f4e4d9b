// SPDX-License-Identifier: Apache-2.0
// Plain loops over the tokens of a transformer: layer norm and GELU, in float32 whatever the tokens hold.
#pragma once

#include <cstdint>

#include "model/kernels/simd.h"

namespace holdfast {

template <typename T>
struct NormedTokens {
  int64_t channels = 0;
  float epsilon = 0;
  const float* weight = nullptr;  // [channels]
  const float* bias = nullptr;    // [channels]
  const T* x = nullptr;           // [tokens, channels]
  T* y = nullptr;                 // [tokens, channels]; may be x
};

// Tokens [begin, end): (x - mean) / deviation * weight + bias, of each by itself.
void NormTokens(const NormedTokens<float>& tokens, int64_t begin, int64_t end);
void NormTokens(const NormedTokens<Bf16>& tokens, int64_t begin, int64_t end);

// Values [begin, end) of x in place: x / 2 * (1 + erf(x / sqrt 2)), within 4e-7 absolute before rounding to T.
void GeluValues(float* x, int64_t begin, int64_t end);
void GeluValues(Bf16* x, int64_t begin, int64_t end);

}  // namespace holdfast
