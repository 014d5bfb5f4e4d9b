// SPDX-License-Identifier: Apache-2.0
// Plain loops behind the attention of patches to their 3 x 3 neighbourhood. Only tokens on the map are gathered, so
// there is no padding to mask; scores never leave the cache.
#pragma once

#include <cstdint>

#include "model/kernels/simd.h"

namespace holdfast {

template <typename T>
struct AttentionMaps {
  int64_t height = 0;
  int64_t width = 0;
  int64_t channels = 0;
  int64_t heads = 0;
  int64_t patch = 0;         // side of a patch, tokens
  const T* query = nullptr;  // [F, height, width, channels]; head h has channels h * D ..., D = channels / heads
  const T* value = nullptr;  // as 'query': keys and values
  T* out = nullptr;          // as 'query'; read by the backward pass

  // Backward pass.
  const T* grad_out = nullptr;
  float* grad_query = nullptr;
  float* grad_value = nullptr;  // zeroed

  int64_t patch_rows() const { return (height + patch - 1) / patch; }
  int64_t patch_columns() const { return (width + patch - 1) / patch; }
  int64_t head_channels() const { return channels / heads; }
  // Floats of scratch memory that one thread needs.
  int64_t scratch_floats() const;
};

// Items [begin, end) of the F * heads * patch_rows rows of patches.
void AttendItems(const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end);
void AttendItems(const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end);
// Items [begin, end) of the F * heads head maps.
void AttendBackwardItems(const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end);
void AttendBackwardItems(const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end);

}  // namespace holdfast
