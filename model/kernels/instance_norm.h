// SPDX-License-Identifier: Apache-2.0
// Plain loops behind instance_norm.cc. A map is [pixels, C]; moments are taken over blocks of kNormBlock pixels, which
// are joined in a fixed order: the result depends on nothing but the map.
#pragma once

#include <cstdint>

#include "model/kernels/simd.h"

namespace holdfast {

constexpr int64_t kNormBlock = 256;
constexpr float kNormEpsilon = 1e-5f;

enum class NormTail { kNone, kRelu, kReluAddRelu };

inline int64_t NormBlocks(int64_t pixels) { return (pixels + kNormBlock - 1) / kNormBlock; }

template <typename T>
struct NormMaps {
  int64_t pixels = 0;
  int64_t channels = 0;
  NormTail tail = NormTail::kNone;
  const T* x = nullptr;         // [N, pixels, C]
  const T* identity = nullptr;  // [N, pixels, C], kReluAddRelu only
  T* y = nullptr;               // [N, pixels, C] result; read by the backward pass
  float* moments = nullptr;     // [N, 2, C]: mean, 1 / deviation
  float* partial = nullptr;     // [N, blocks, 2, C]

  // Backward pass.
  const T* grad_y = nullptr;
  T* grad_x = nullptr;
  T* grad_identity = nullptr;
  float* sums = nullptr;  // [N, 2, C]: means of g and of g * normed x
};

// Each pass works on items [begin, end): of the N * blocks blocks, or of the N maps.
void NormBlockMoments(const NormMaps<float>& maps, int64_t begin, int64_t end);
void NormBlockMoments(const NormMaps<Bf16>& maps, int64_t begin, int64_t end);
// Moments of one map from those of its blocks, of which the last may be smaller.
struct NormedPixels {
  int64_t all;
  int64_t block;
};
void NormJoinMoments(const float* partial, const NormedPixels& pixels, int64_t channels, float* moments);
void NormApply(const NormMaps<float>& maps, int64_t begin, int64_t end);
void NormApply(const NormMaps<Bf16>& maps, int64_t begin, int64_t end);

// Sums of the gradient before the norm, block by block into 'partial'; grad_identity is written on the way.
void NormBlockGradients(const NormMaps<float>& maps, int64_t begin, int64_t end);
void NormBlockGradients(const NormMaps<Bf16>& maps, int64_t begin, int64_t end);
void NormJoinGradients(const float* partial, int64_t pixels, int64_t channels, float* sums);  // of one map
void NormApplyGradients(const NormMaps<float>& maps, int64_t begin, int64_t end);
void NormApplyGradients(const NormMaps<Bf16>& maps, int64_t begin, int64_t end);

}  // namespace holdfast
