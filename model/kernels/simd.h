// SPDX-License-Identifier: Apache-2.0
// Vectors of floats for the CPU kernels, in the compilers' portable vector types, and the choice of instruction set.
// A kernel is a template whose first parameter is the number of floats of a register: HOLDFAST_KERNEL compiles it once
// for each instruction set, and which of them runs is chosen in the process, so one binary runs on any x86-64. A vector
// wider than the registers would live in memory. Kernels are plain loops over pointers: no torch, no lambdas (which
// would not inherit the instruction set).
#pragma once

#include <cstdint>
#include <cstring>

// Defines the function 'name' with 'parameters' (both lists in brackets), which calls the always-inlined template
// 'body' with 'arguments', compiled for the instruction set that runs.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define HOLDFAST_KERNEL(name, parameters, body, arguments)                                       \
  namespace {                                                                                    \
  __attribute__((target("arch=x86-64-v4"))) void name##Avx512 parameters { body<16> arguments; } \
  __attribute__((target("arch=x86-64-v3"))) void name##Avx2 parameters { body<8> arguments; }    \
  void name##Base parameters { body<4> arguments; }                                              \
  }                                                                                              \
  void name parameters {                                                                         \
    const InstructionSet set = KernelInstructionSet();                                           \
    if (set == InstructionSet::kAvx512) return name##Avx512 arguments;                           \
    if (set == InstructionSet::kAvx2) return name##Avx2 arguments;                               \
    name##Base arguments;                                                                        \
  }
#else
// NOLINTBEGIN(bugprone-macro-parentheses): they come with what is passed.
#define HOLDFAST_KERNEL(name, parameters, body, arguments) \
  void name parameters { body<4> arguments; }
// NOLINTEND(bugprone-macro-parentheses)
#endif
#define HOLDFAST_INLINE inline __attribute__((always_inline))

namespace holdfast {

// kBase is what every processor of the architecture has: SSE2, or NEON.
enum class InstructionSet { kBase, kAvx2, kAvx512 };
// The best that values of oneDNN's environment variables ONEDNN_MAX_CPU_ISA and DNNL_MAX_CPU_ISA allow, or null where
// one is not set: as in oneDNN, the first one counts unless it is empty, and letters may be small.
InstructionSet AllowedInstructionSet(const char* onednn, const char* dnnl);
// The best that the processor has and those variables, read once, allow.
InstructionSet KernelInstructionSet();

// The upper half of a float32, as bfloat16 tensors store it.
struct Bf16 {
  uint16_t bits;
};

// Not 'using': GCC takes no notice of such an attribute there when it depends on a template's parameter.
template <int64_t kWidth>
struct VectorTypes {
  typedef float Floats __attribute__((vector_size(kWidth * sizeof(float))));
  typedef int32_t Ints __attribute__((vector_size(kWidth * sizeof(int32_t))));
  typedef uint32_t Words __attribute__((vector_size(kWidth * sizeof(uint32_t))));
  typedef uint16_t Halves __attribute__((vector_size(kWidth * sizeof(uint16_t))));
};
// kWidth floats; templates below that take such a vector call its type V.
template <int64_t kWidth>
using Lanes = typename VectorTypes<kWidth>::Floats;
template <typename V>
constexpr int64_t kLanesOf = sizeof(V) / sizeof(float);

constexpr int64_t kMaxLanes = 16;
HOLDFAST_INLINE int64_t RoundUp(int64_t count, int64_t unit) { return (count + unit - 1) / unit * unit; }

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

template <int64_t kWidth>
HOLDFAST_INLINE Lanes<kWidth> Load(const float* from) {
  Lanes<kWidth> result;
  std::memcpy(&result, from, sizeof(result));
  return result;
}
template <int64_t kWidth>
HOLDFAST_INLINE Lanes<kWidth> Load(const Bf16* from) {
  typename VectorTypes<kWidth>::Halves halves;
  std::memcpy(&halves, from, sizeof(halves));
  return reinterpret_cast<Lanes<kWidth>>(__builtin_convertvector(halves, typename VectorTypes<kWidth>::Words) << 16);
}
// The first 'count' < kWidth values, zeros behind them.
template <int64_t kWidth, typename T>
HOLDFAST_INLINE Lanes<kWidth> LoadTail(const T* from, int64_t count) {
  float values[kWidth] = {};
  for (int64_t i = 0; i < count; ++i) values[i] = ToFloat(from[i]);
  return Load<kWidth>(values);
}
template <typename V>
HOLDFAST_INLINE void Store(V value, float* to) {
  std::memcpy(to, &value, sizeof(value));
}
// Rounds as Assign does.
template <typename V>
HOLDFAST_INLINE void Store(V value, Bf16* to) {
  using Types = VectorTypes<kLanesOf<V>>;
  using Words = typename Types::Words;
  const Words bits = reinterpret_cast<Words>(value);
  const Words rounded = (bits + 0x7fffu + ((bits >> 16) & 1u)) >> 16;
  const Words kept = value == value ? rounded : (Words{} + 0x7fc0u);
  const auto halves = __builtin_convertvector(kept, typename Types::Halves);
  std::memcpy(to, &halves, sizeof(halves));
}

HOLDFAST_INLINE Lanes<4> LowerHalf(Lanes<8> v) { return __builtin_shufflevector(v, v, 0, 1, 2, 3); }
HOLDFAST_INLINE Lanes<4> UpperHalf(Lanes<8> v) { return __builtin_shufflevector(v, v, 4, 5, 6, 7); }
HOLDFAST_INLINE Lanes<8> LowerHalf(Lanes<16> v) { return __builtin_shufflevector(v, v, 0, 1, 2, 3, 4, 5, 6, 7); }
HOLDFAST_INLINE Lanes<8> UpperHalf(Lanes<16> v) { return __builtin_shufflevector(v, v, 8, 9, 10, 11, 12, 13, 14, 15); }

HOLDFAST_INLINE float Sum(Lanes<4> v) { return (v[0] + v[2]) + (v[1] + v[3]); }
template <typename V>
HOLDFAST_INLINE float Sum(V v) {
  return Sum(LowerHalf(v) + UpperHalf(v));
}
// The sums of four vectors, each as Sum gives it.
HOLDFAST_INLINE Lanes<4> SumEach(const Lanes<4> (&v)[4]) {
  const Lanes<4> front =
      __builtin_shufflevector(v[0], v[1], 0, 4, 1, 5) + __builtin_shufflevector(v[0], v[1], 2, 6, 3, 7);
  const Lanes<4> back =
      __builtin_shufflevector(v[2], v[3], 0, 4, 1, 5) + __builtin_shufflevector(v[2], v[3], 2, 6, 3, 7);
  return __builtin_shufflevector(front, back, 0, 1, 4, 5) + __builtin_shufflevector(front, back, 2, 3, 6, 7);
}
template <typename V>
HOLDFAST_INLINE Lanes<4> SumEach(const V (&v)[4]) {
  decltype(LowerHalf(v[0])) halves[4];
  for (int i = 0; i < 4; ++i) halves[i] = LowerHalf(v[i]) + UpperHalf(v[i]);
  return SumEach(halves);
}

// The second one where either is not a number.
template <typename V>
HOLDFAST_INLINE V Max(V a, V b) {
  return a > b ? a : b;
}
// max(x, 0) of a vector or a float. What is not a number stays so, as with ATen: checks of the network look for it.
template <typename V>
HOLDFAST_INLINE V Relu(V x) {
  return x <= V{} ? V{} : x;
}
template <typename V>
HOLDFAST_INLINE float Largest(V v) {
  float largest = v[0];
  for (int64_t i = 1; i < kLanesOf<V>; ++i) largest = v[i] > largest ? v[i] : largest;
  return largest;
}

// 2^x to about 2e-7 relative for x <= 0 (softmax needs no more); below -126 it gives 2^-126. What is not a number stays
// so.
template <typename V>
HOLDFAST_INLINE V Exp2OfNegative(V x) {
  constexpr float kRounder = 12582912.0f;  // 1.5 * 2^23: adding it leaves the nearest integer in the low bits
  using Ints = typename VectorTypes<kLanesOf<V>>::Ints;
  x = Max(V{} - 126.0f, x);
  const V shifted = x + kRounder;
  const V r = x - (shifted - kRounder);
  V p = r * 1.3264726839e-3f + 9.6715126653e-3f;
  p = p * r + 5.5507337444e-2f;
  p = p * r + 2.4022242085e-1f;
  p = p * r + 6.9314697760e-1f;
  p = p * r + 1.0f;
  // The integer's bits move into the exponent; those of the rounder leave at the top.
  return reinterpret_cast<V>(reinterpret_cast<Ints>(p) + (reinterpret_cast<Ints>(shifted) << 23));
}

}  // namespace holdfast
