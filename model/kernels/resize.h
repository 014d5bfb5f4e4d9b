// SPDX-License-Identifier: Apache-2.0
// The plain loops behind resize.cc.
#pragma once

#include <cstdint>
#include <vector>

#include "model/kernels/simd.h"

namespace holdfast {

// Where a place of the resized axis lies on the source's axis: between 'first' and 'second', 'share' of the way.
// Always float32, whatever the maps hold: bfloat16 has eight bits and cannot name the columns of a map of 288.
struct ResizePlace {
  int64_t first = 0;
  int64_t second = 0;
  float share = 0;
};

// Corners on corners: place 0 lies on 0, place out - 1 on in - 1. REQUIRES: out > 0, in > 0.
std::vector<ResizePlace> ResizePlaces(int64_t out, int64_t in);

// Maps [N, H, W, C] resized bilinearly to [N, h, w, C]. The places have been computed once for all of them.
template <typename T>
struct ResizedMaps {
  int64_t channels = 0;
  int64_t height = 0, width = 0;          // H, W
  int64_t out_height = 0, out_width = 0;  // h, w
  const ResizePlace* rows = nullptr;      // [h]
  const ResizePlace* columns = nullptr;   // [w]
  const T* map = nullptr;                 // [N, H, W, C]
  T* out = nullptr;                       // [N, h, w, C], C of out_step channels of each pixel
  int64_t out_step = 0;                   // at least C
  const T* grad_out = nullptr;            // [N, h, w, C]
  T* grad = nullptr;                      // [N, H, W, C]
};

// Writes rows [begin, end) of the N * h rows of the result.
void ResizeRows(const ResizedMaps<float>& maps, int64_t begin, int64_t end);
void ResizeRows(const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end);

// Writes rows [begin, end) of the N * H rows of the gradient; 'row' [W, C] is scratch.
void ResizeGradients(const ResizedMaps<float>& maps, int64_t begin, int64_t end, float* row);
void ResizeGradients(const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end, float* row);

}  // namespace holdfast
