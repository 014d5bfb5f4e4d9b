// SPDX-License-Identifier: Apache-2.0
#include "model/resize_kernel.h"

#include <algorithm>

namespace holdfast {
namespace {

// Where place 'index' of an axis of 'out' places lies on one of 'in' places: between 'first' and 'second', 'share' of
// the way.
struct Place {
  int64_t first;
  int64_t second;
  float share;
};

HOLDFAST_INLINE Place PlaceOf(int64_t index, int64_t out, int64_t in) {
  const float scale = out > 1 ? static_cast<float>(in - 1) / static_cast<float>(out - 1) : 0.0f;
  const float at = static_cast<float>(index) * scale;
  const int64_t first = std::min(static_cast<int64_t>(at), in - 1);
  return {first, std::min(first + 1, in - 1), at - static_cast<float>(first)};
}

// What a row of the result gives to a row of the source, of which it took 'weight'.
template <typename T>
HOLDFAST_INLINE void AddRow(const ResizedMaps<T>& m, const T* __restrict grad_out, float weight,
                            float* __restrict row) {
  for (int64_t x = 0; x < m.out_width; ++x) {
    const Place at = PlaceOf(x, m.out_width, m.width);
    const float left = weight * (1 - at.share);
    const float right = weight * at.share;
    const T* g = grad_out + x * m.channels;
    float* first = row + at.first * m.channels;
    float* second = row + at.second * m.channels;
    for (int64_t c = 0; c < m.channels; ++c) first[c] += left * ToFloat(g[c]);
    for (int64_t c = 0; c < m.channels; ++c) second[c] += right * ToFloat(g[c]);
  }
}

template <typename T>
HOLDFAST_INLINE void Gradients(const ResizedMaps<T>& m, int64_t begin, int64_t end, float* __restrict row) {
  const int64_t values = m.width * m.channels;
  for (int64_t i = begin; i < end; ++i) {
    const int64_t y = i % m.height;
    const T* grad_out = m.grad_out + i / m.height * m.out_height * m.out_width * m.channels;
    std::fill_n(row, values, 0.0f);
    for (int64_t out_y = 0; out_y < m.out_height; ++out_y) {
      const Place at = PlaceOf(out_y, m.out_height, m.height);
      const float weight = (at.first == y ? 1 - at.share : 0) + (at.second == y ? at.share : 0);
      if (weight != 0) AddRow(m, grad_out + out_y * m.out_width * m.channels, weight, row);
    }
    T* __restrict grad = m.grad + i * values;
    for (int64_t j = 0; j < values; ++j) Assign(row[j], grad + j);
  }
}

}  // namespace

HOLDFAST_SIMD void ResizeGradients(const ResizedMaps<float>& maps, int64_t begin, int64_t end, float* row) {
  Gradients(maps, begin, end, row);
}
HOLDFAST_SIMD void ResizeGradients(const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end, float* row) {
  Gradients(maps, begin, end, row);
}

}  // namespace holdfast
