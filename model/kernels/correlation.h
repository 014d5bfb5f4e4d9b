// SPDX-License-Identifier: Apache-2.0
// Plain loops behind correlation.cc and sampling.cc. Maps hold T; templates, results and gradients are float.
#pragma once

#include <cstdint>

#include "model/kernels/map_view.h"
#include "model/kernels/simd.h"

namespace holdfast {

constexpr int64_t kMaxCorrelationRadius = 8;
constexpr int64_t kMaxTemplates = 3;

struct CorrelationRows {
  RowMaps maps;
  int64_t radius = 0;
  int64_t templates = 0;            // K
  const float* features = nullptr;  // [N, S, K, C]
  const float* xy = nullptr;        // [N, S, 2] feature pixels of level 0
  float* out = nullptr;             // [N, S, K, L, (2R+1)^2]

  // Backward pass, one window only.
  const float* grad_out = nullptr;     // as 'out'
  float* grad_features = nullptr;      // as 'features', zeroed
  const MapView* grad_maps = nullptr;  // float, like maps.maps, zeroed
};

// Items [begin, end) of the N * S (row, frame) pairs.
void CorrelateItems(const CorrelationRows& rows, float, int64_t begin, int64_t end);
void CorrelateItems(const CorrelationRows& rows, Bf16, int64_t begin, int64_t end);
// Frames [begin, end) of the window: a frame's gradient is summed by one thread in the order of the rows.
void CorrelateFramesBackward(const CorrelationRows& rows, float, int64_t begin, int64_t end);
void CorrelateFramesBackward(const CorrelationRows& rows, Bf16, int64_t begin, int64_t end);

struct SampledRows {
  RowMaps maps;               // only level 0 is read
  const float* xy = nullptr;  // [N, S, 2] feature pixels
  float* out = nullptr;       // [N, S, C]

  // Backward pass, one window only.
  const float* grad_out = nullptr;     // as 'out'
  const MapView* grad_maps = nullptr;  // float, like maps.maps, zeroed
};

void SampleItems(const SampledRows& rows, float, int64_t begin, int64_t end);
void SampleItems(const SampledRows& rows, Bf16, int64_t begin, int64_t end);
void SampleFramesBackward(const SampledRows& rows, int64_t begin, int64_t end);

}  // namespace holdfast
