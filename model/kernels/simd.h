// SPDX-License-Identifier: Apache-2.0
// Sixteen floats at a time for the CPU kernels, in the compilers' portable vector types. A kernel marked HOLDFAST_SIMD
// is compiled for several instruction sets and chosen when the program starts, so one binary runs on any x86-64.
// Kernels are plain loops over pointers: no torch, no lambdas (which would not inherit the instruction set).
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(HOLDFAST_SANITIZED)
#define HOLDFAST_SIMD __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define HOLDFAST_SIMD
#endif
#define HOLDFAST_INLINE inline __attribute__((always_inline))

namespace holdfast {

// The upper half of a float32, as bfloat16 tensors store it.
struct Bf16 {
  uint16_t bits;
};

using Lanes = float __attribute__((vector_size(64)));
using IntLanes = int32_t __attribute__((vector_size(64)));
constexpr int64_t kLanes = 16;

HOLDFAST_INLINE float ToFloat(float value) { return value; }
HOLDFAST_INLINE float ToFloat(Bf16 value) {
  const uint32_t bits = static_cast<uint32_t>(value.bits) << 16;
  float result;
  std::memcpy(&result, &bits, sizeof(result));
  return result;
}

HOLDFAST_INLINE void Assign(float value, float* to) { *to = value; }
// Rounds to nearest, ties to even; a NaN stays one.
HOLDFAST_INLINE void Assign(float value, Bf16* to) {
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  const uint32_t rounded = (bits + 0x7fffu + ((bits >> 16) & 1u)) >> 16;
  to->bits = static_cast<uint16_t>(value == value ? rounded : 0x7fc0u);
}

HOLDFAST_INLINE Lanes Load(const float* from) {
  Lanes result;
  std::memcpy(&result, from, sizeof(result));
  return result;
}
HOLDFAST_INLINE Lanes Load(const Bf16* from) {
  using Halves = uint16_t __attribute__((vector_size(32)));
  using Words = uint32_t __attribute__((vector_size(64)));
  Halves halves;
  std::memcpy(&halves, from, sizeof(halves));
  return reinterpret_cast<Lanes>(__builtin_convertvector(halves, Words) << 16);
}
// The first 'count' < kLanes values, zeros behind them.
template <typename T>
HOLDFAST_INLINE Lanes LoadTail(const T* from, int64_t count) {
  float values[kLanes] = {};
  for (int64_t i = 0; i < count; ++i) values[i] = ToFloat(from[i]);
  return Load(values);
}
HOLDFAST_INLINE void Store(Lanes value, float* to) { std::memcpy(to, &value, sizeof(value)); }
// Cuts off the lower halves: for values that are bfloat16 already.
HOLDFAST_INLINE void StoreExact(Lanes value, float* to) { Store(value, to); }
HOLDFAST_INLINE void StoreExact(Lanes value, Bf16* to) {
  using Halves = uint16_t __attribute__((vector_size(32)));
  using Words = uint32_t __attribute__((vector_size(64)));
  const Halves halves = __builtin_convertvector(reinterpret_cast<Words>(value) >> 16, Halves);
  std::memcpy(to, &halves, sizeof(halves));
}

HOLDFAST_INLINE float Sum(Lanes v) {
  using Eight = float __attribute__((vector_size(32)));
  using Four = float __attribute__((vector_size(16)));
  const Eight eight = __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7) +
                      __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15);
  const Four four =
      __builtin_shufflevector(eight, eight, 0, 1, 2, 3) + __builtin_shufflevector(eight, eight, 4, 5, 6, 7);
  return (four[0] + four[2]) + (four[1] + four[3]);
}

HOLDFAST_INLINE Lanes Max(Lanes a, Lanes b) { return a > b ? a : b; }

// e^x to about 2e-7 relative for x <= 0 (softmax needs no more); below -87 it gives e^-87.
HOLDFAST_INLINE Lanes ExpOfNegative(Lanes x) {
  const Lanes floor = Lanes{} - 87.0f;
  x = Max(x, floor);
  constexpr float kRounder = 12582912.0f;  // 1.5 * 2^23: adding it leaves the nearest integer in the low bits
  const Lanes shifted = x * 1.44269504f + kRounder;
  const Lanes n = shifted - kRounder;
  const Lanes r = (x - n * 0.693359375f) + n * 2.12194440e-4f;  // ln 2 in two parts
  Lanes p = r * 1.9875691500e-4f + 1.3981999507e-3f;
  p = p * r + 8.3334519073e-3f;
  p = p * r + 4.1665795894e-2f;
  p = p * r + 1.6666665459e-1f;
  p = p * r + 5.0000001201e-1f;
  p = p * r * r + r + 1.0f;
  const IntLanes exponent = (reinterpret_cast<IntLanes>(shifted) - 0x4b400000 + 127) << 23;
  return p * reinterpret_cast<Lanes>(exponent);
}

}  // namespace holdfast
