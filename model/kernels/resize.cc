// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/resize.h"

#include <algorithm>

namespace holdfast {
namespace {

// One row of the result from the two rows of the source that it lies between.
template <typename T>
HOLDFAST_INLINE void MixRows(const ResizedMaps<T>& m, const T* __restrict top, const T* __restrict bottom, float share,
                             T* __restrict out) {
  for (int64_t x = 0; x < m.out_width; ++x) {
    const ResizePlace at = m.columns[x];
    const float left = 1 - at.share, above = 1 - share;
    const T* top_left = top + at.first * m.channels;
    const T* top_right = top + at.second * m.channels;
    const T* bottom_left = bottom + at.first * m.channels;
    const T* bottom_right = bottom + at.second * m.channels;
    T* pixel = out + x * m.out_step;
    for (int64_t c = 0; c < m.channels; ++c) {
      const float upper = left * ToFloat(top_left[c]) + at.share * ToFloat(top_right[c]);
      const float lower = left * ToFloat(bottom_left[c]) + at.share * ToFloat(bottom_right[c]);
      Assign(above * upper + share * lower, pixel + c);
    }
  }
}

template <int64_t, typename T>
HOLDFAST_INLINE void Rows(const ResizedMaps<T>& m, int64_t begin, int64_t end) {
  const int64_t values = m.width * m.channels;
  for (int64_t i = begin; i < end; ++i) {
    const ResizePlace at = m.rows[i % m.out_height];
    const T* map = m.map + i / m.out_height * m.height * values;
    MixRows(m, map + at.first * values, map + at.second * values, at.share, m.out + i * m.out_width * m.out_step);
  }
}

// What a row of the result gives to a row of the source, of which it took 'weight'.
template <typename T>
HOLDFAST_INLINE void AddRow(const ResizedMaps<T>& m, const T* __restrict grad_out, float weight,
                            float* __restrict row) {
  for (int64_t x = 0; x < m.out_width; ++x) {
    const ResizePlace at = m.columns[x];
    const float left = weight * (1 - at.share);
    const float right = weight * at.share;
    const T* g = grad_out + x * m.channels;
    float* first = row + at.first * m.channels;
    float* second = row + at.second * m.channels;
    for (int64_t c = 0; c < m.channels; ++c) first[c] += left * ToFloat(g[c]);
    for (int64_t c = 0; c < m.channels; ++c) second[c] += right * ToFloat(g[c]);
  }
}

template <int64_t, typename T>
HOLDFAST_INLINE void Gradients(const ResizedMaps<T>& m, int64_t begin, int64_t end, float* __restrict row) {
  const int64_t values = m.width * m.channels;
  for (int64_t i = begin; i < end; ++i) {
    const int64_t y = i % m.height;
    const T* grad_out = m.grad_out + i / m.height * m.out_height * m.out_width * m.channels;
    std::fill_n(row, values, 0.0f);
    for (int64_t out_y = 0; out_y < m.out_height; ++out_y) {
      const ResizePlace at = m.rows[out_y];
      const float weight = (at.first == y ? 1 - at.share : 0) + (at.second == y ? at.share : 0);
      if (weight != 0) AddRow(m, grad_out + out_y * m.out_width * m.channels, weight, row);
    }
    T* __restrict grad = m.grad + i * values;
    for (int64_t j = 0; j < values; ++j) Assign(row[j], grad + j);
  }
}

}  // namespace

std::vector<ResizePlace> ResizePlaces(int64_t out, int64_t in) {
  const float scale = out > 1 ? static_cast<float>(in - 1) / static_cast<float>(out - 1) : 0.0f;
  std::vector<ResizePlace> places(static_cast<size_t>(out));
  for (int64_t i = 0; i < out; ++i) {
    const float at = static_cast<float>(i) * scale;
    // Rounding may carry 'at' up to the next whole number, never past the map.
    const int64_t first = std::min(static_cast<int64_t>(at), in - 1);
    places[static_cast<size_t>(i)] = {first, std::min(first + 1, in - 1), at - static_cast<float>(first)};
  }
  return places;
}

HOLDFAST_KERNEL(ResizeRows, (const ResizedMaps<float>& maps, int64_t begin, int64_t end), Rows, (maps, begin, end))
HOLDFAST_KERNEL(ResizeRows, (const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end), Rows, (maps, begin, end))
HOLDFAST_KERNEL(ResizeGradients, (const ResizedMaps<float>& maps, int64_t begin, int64_t end, float* row), Gradients,
                (maps, begin, end, row))
HOLDFAST_KERNEL(ResizeGradients, (const ResizedMaps<Bf16>& maps, int64_t begin, int64_t end, float* row), Gradients,
                (maps, begin, end, row))

}  // namespace holdfast
