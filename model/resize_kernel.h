// SPDX-License-Identifier: Apache-2.0
// The plain loop behind the backward pass of resize.cc.
#pragma once

#include <cstdint>

#include "model/simd.h"

namespace holdfast {

// Maps [H, W, C] that were resized bilinearly, corners on corners, to [h, w, C].
template <typename T>
struct ResizedMaps {
  int64_t channels = 0;
  int64_t height = 0, width = 0;          // H, W
  int64_t out_height = 0, out_width = 0;  // h, w
  const T* grad_out = nullptr;            // [N, h, w, C]
  T* grad = nullptr;                      // [N, H, W, C]
};

// Works on rows [begin, end) of the N * H rows of the gradient; 'row' [W, C] is scratch.
void ResizeGradients(const ResizedMaps<float>& maps, int64_t begin, int64_t end, float* row);
void ResizeGradients(const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end, float* row);

}  // namespace holdfast
