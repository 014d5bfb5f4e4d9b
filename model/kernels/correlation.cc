// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/correlation.h"

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

constexpr int64_t kMaxSide = 2 * kMaxCorrelationRadius + 2;
constexpr int64_t kMaxCells = kMaxSide * kMaxSide;
// Positions beyond this are as good as anywhere outside; keeps the conversion to integers defined (NaN included).
constexpr float kFarAway = 1e6f;

// The cells around a position at one level: columns x0 .. x0 + side - 1, rows y0 .. y0 + side - 1, of which those with
// index [x_begin, x_end) and [y_begin, y_end) lie on the map; (fx, fy) is the shift all offsets share.
struct Patch {
  int64_t x0, y0;
  int64_t x_begin, x_end, y_begin, y_end;
  float fx, fy;
};

HOLDFAST_INLINE Patch PatchAt(const float* xy, int64_t level, int64_t radius, const MapView& map) {
  const float scale = 1.0f / static_cast<float>(int64_t{1} << level);
  const float x = xy[0] * scale;
  const float y = xy[1] * scale;
  Patch patch = {};
  if (!(std::fabs(x) < kFarAway && std::fabs(y) < kFarAway)) return patch;
  const int64_t side = 2 * radius + 2;
  patch.x0 = static_cast<int64_t>(std::floor(x)) - radius;
  patch.y0 = static_cast<int64_t>(std::floor(y)) - radius;
  patch.fx = x - std::floor(x);
  patch.fy = y - std::floor(y);
  patch.x_begin = std::max<int64_t>(0, -patch.x0);
  patch.y_begin = std::max<int64_t>(0, -patch.y0);
  patch.x_end = std::min(side, map.width - patch.x0);
  patch.y_end = std::min(side, map.height - patch.y0);
  return patch;
}

// A sample between four cells is a blend of the cells, and a dot product is linear, so the blend of four dot products
// is that of the sample: the (2R+2)^2 cells around a position are multiplied once each, where (2R+1)^2 samples of four
// cells each would be three times the work at R = 3. For the same reason K templates share each load of a cell.

// Dot products of one cell with K templates, 'step' floats apart from one another in 'out'.
template <int64_t kWidth, int kTemplates, typename T>
HOLDFAST_INLINE void Dots(const T* cell, const float* features, int64_t channels, float* out, int64_t step) {
  Lanes<kWidth> sums[kTemplates] = {};
  int64_t c = 0;
  for (; c + kWidth <= channels; c += kWidth) {
    const Lanes<kWidth> value = Load<kWidth>(cell + c);
    for (int k = 0; k < kTemplates; ++k) sums[k] += value * Load<kWidth>(features + k * channels + c);
  }
  if (c < channels) {
    const Lanes<kWidth> value = LoadTail<kWidth>(cell + c, channels - c);
    for (int k = 0; k < kTemplates; ++k) {
      sums[k] += value * LoadTail<kWidth>(features + k * channels + c, channels - c);
    }
  }
  for (int k = 0; k < kTemplates; ++k) out[k * step] = Sum(sums[k]);
}

// The same for four cells 'stride' values apart: a load of a template serves all of them, and their sums are added up
// together. To the bit what Dots gives for each.
template <int64_t kWidth, int kTemplates, typename T>
HOLDFAST_INLINE void FourDots(const T* cells, int64_t stride, const float* features, int64_t channels, float* out,
                              int64_t step) {
  Lanes<kWidth> sums[kTemplates][4] = {};
  int64_t c = 0;
  for (; c + kWidth <= channels; c += kWidth) {
    for (int i = 0; i < 4; ++i) {
      const Lanes<kWidth> value = Load<kWidth>(cells + i * stride + c);
      for (int k = 0; k < kTemplates; ++k) sums[k][i] += value * Load<kWidth>(features + k * channels + c);
    }
  }
  for (int i = 0; c < channels && i < 4; ++i) {
    const Lanes<kWidth> value = LoadTail<kWidth>(cells + i * stride + c, channels - c);
    for (int k = 0; k < kTemplates; ++k) {
      sums[k][i] += value * LoadTail<kWidth>(features + k * channels + c, channels - c);
    }
  }
  for (int k = 0; k < kTemplates; ++k) Store(SumEach(sums[k]), out + k * step);
}

// dots [side, side], column-major (x outer, y inner), and a register's floats behind them -> out [2R+1, 2R+1].
template <int64_t kWidth>
HOLDFAST_INLINE void Blend(const float* dots, const Patch& patch, int64_t radius, float scale, float* out) {
  const int64_t side = 2 * radius + 2;
  const int64_t width = side - 1;
  float down[kMaxCells + kMaxSide + kMaxLanes];  // blended along y; the last of each column means nothing
  for (int64_t i = 0; i < side * side; i += kWidth) {
    Store((1 - patch.fy) * Load<kWidth>(dots + i) + patch.fy * Load<kWidth>(dots + i + 1), down + i);
  }
  float both[kMaxCells + kMaxLanes];
  for (int64_t i = 0; i < width * side; i += kWidth) {
    const Lanes<kWidth> left = (1 - patch.fx) * Load<kWidth>(down + i);
    Store(scale * (left + patch.fx * Load<kWidth>(down + i + side)), both + i);
  }
  for (int64_t a = 0; a < width; ++a) {
    // NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign): the loop before wrote them, a register at a time.
    for (int64_t b = 0; b < width; ++b) out[a * width + b] = both[a * side + b];
  }
}

// The transpose of Blend.
HOLDFAST_INLINE void BlendBackward(const float* __restrict grad_out, const Patch& patch, int64_t radius, float scale,
                                   float* __restrict grad_dots) {
  const int64_t side = 2 * radius + 2;
  const int64_t width = side - 1;
  float columns[kMaxSide * (kMaxSide - 1)];
  std::fill_n(columns, side * width, 0.0f);
  for (int64_t j = 0; j < width * width; ++j) {
    columns[j] += scale * (1 - patch.fx) * grad_out[j];
    columns[j + width] += scale * patch.fx * grad_out[j];
  }
  std::fill_n(grad_dots, side * side, 0.0f);
  for (int64_t a = 0; a < side; ++a) {
    for (int64_t b = 0; b < width; ++b) {
      grad_dots[a * side + b] += (1 - patch.fy) * columns[a * width + b];
      grad_dots[a * side + b + 1] += patch.fy * columns[a * width + b];
    }
  }
}

// Dot products of all cells of a patch with K templates -> dots [K, side, side], zero outside the map.
template <int64_t kWidth, int kTemplates, typename T>
HOLDFAST_INLINE void DotsOfPatch(const MapView& map, const Patch& patch, int64_t side, const float* features,
                                 int64_t channels, float* dots) {
  const int64_t cells = side * side;
  const int64_t stride = map.width * channels;
  std::fill_n(dots, kTemplates * cells, 0.0f);
  for (int64_t a = patch.x_begin; a < patch.x_end; ++a) {
    const T* column = static_cast<const T*>(map.data) + patch.y0 * stride + (patch.x0 + a) * channels;
    float* out = dots + a * side;
    int64_t b = patch.y_begin;
    for (; b + 4 <= patch.y_end; b += 4) {
      FourDots<kWidth, kTemplates>(column + b * stride, stride, features, channels, out + b, cells);
    }
    for (; b < patch.y_end; ++b) Dots<kWidth, kTemplates>(column + b * stride, features, channels, out + b, cells);
  }
}

template <int64_t kWidth, int kTemplates, typename T>
HOLDFAST_INLINE void CorrelateItem(const CorrelationRows& rows, int64_t item) {
  const RowMaps& m = rows.maps;
  const MapView* maps = m.At(item / m.frames, item % m.frames);
  const float* features = rows.features + item * kTemplates * m.channels;
  const int64_t side = 2 * rows.radius + 2;
  const int64_t cells = side * side;
  const int64_t offsets = (side - 1) * (side - 1);
  const float scale = 1.0f / std::sqrt(static_cast<float>(m.channels));
  float dots[kTemplates * kMaxCells + 2 * kMaxLanes];
  std::fill_n(dots + kTemplates * cells, 2 * kMaxLanes, 0.0f);
  for (int64_t level = 0; level < m.levels; ++level) {
    const Patch patch = PatchAt(rows.xy + item * 2, level, rows.radius, maps[level]);
    DotsOfPatch<kWidth, kTemplates, T>(maps[level], patch, side, features, m.channels, dots);
    for (int k = 0; k < kTemplates; ++k) {
      float* out = rows.out + ((item * kTemplates + k) * m.levels + level) * offsets;
      Blend<kWidth>(dots + k * cells, patch, rows.radius, scale, out);
    }
  }
}

// Frame by frame, so that a frame's maps stay in the cache while all rows read them: pair 'i' of that order -> its item
// row * S + frame.
HOLDFAST_INLINE int64_t ItemAt(const RowMaps& maps, int64_t i) { return i % maps.rows * maps.frames + i / maps.rows; }

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void Correlate(const CorrelationRows& rows, T, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const int64_t item = ItemAt(rows.maps, i);
    if (rows.templates == 1) CorrelateItem<kWidth, 1, T>(rows, item);
    if (rows.templates == 2) CorrelateItem<kWidth, 2, T>(rows, item);
    if (rows.templates == 3) CorrelateItem<kWidth, 3, T>(rows, item);
  }
}

// One cell's share: its own gradient, and its part of the template's.
template <typename T>
HOLDFAST_INLINE void CellBackward(float grad, const T* __restrict cell, const float* __restrict feature,
                                  int64_t channels, float* __restrict grad_cell, float* __restrict grad_feature) {
  for (int64_t c = 0; c < channels; ++c) {
    grad_cell[c] += grad * feature[c];
    grad_feature[c] += grad * ToFloat(cell[c]);
  }
}

template <typename T>
HOLDFAST_INLINE void LevelBackward(const CorrelationRows& rows, int64_t item, int64_t level) {
  const RowMaps& m = rows.maps;
  const int64_t map_index = (item % m.frames) * m.levels + level;
  const MapView& map = m.maps[map_index];
  const int64_t side = 2 * rows.radius + 2;
  const int64_t offsets = (side - 1) * (side - 1);
  const float scale = 1.0f / std::sqrt(static_cast<float>(m.channels));
  const Patch patch = PatchAt(rows.xy + item * 2, level, rows.radius, map);
  for (int64_t k = 0; k < rows.templates; ++k) {
    const int64_t index = item * rows.templates + k;
    float grad_dots[kMaxCells];
    BlendBackward(rows.grad_out + (index * m.levels + level) * offsets, patch, rows.radius, scale, grad_dots);
    for (int64_t b = patch.y_begin; b < patch.y_end; ++b) {
      for (int64_t a = patch.x_begin; a < patch.x_end; ++a) {
        const int64_t offset = ((patch.y0 + b) * map.width + patch.x0 + a) * m.channels;
        CellBackward(grad_dots[a * side + b], static_cast<const T*>(map.data) + offset,
                     rows.features + index * m.channels, m.channels,
                     static_cast<float*>(rows.grad_maps[map_index].data) + offset,
                     rows.grad_features + index * m.channels);
      }
    }
  }
}

template <int64_t, typename T>
HOLDFAST_INLINE void CorrelateBackward(const CorrelationRows& rows, T, int64_t begin, int64_t end) {
  for (int64_t frame = begin; frame < end; ++frame) {
    for (int64_t row = 0; row < rows.maps.rows; ++row) {
      for (int64_t level = 0; level < rows.maps.levels; ++level) {
        LevelBackward<T>(rows, row * rows.maps.frames + frame, level);
      }
    }
  }
}

// The four cells around a position clamped to the map, and their weights.
struct Corners {
  int64_t cells[4];
  float weights[4];
};

HOLDFAST_INLINE Corners CornersAt(const float* xy, const MapView& map) {
  const float right = static_cast<float>(map.width - 1);
  const float bottom = static_cast<float>(map.height - 1);
  const float x = xy[0] > 0 ? std::min(xy[0], right) : 0.0f;  // NaN goes to 0
  const float y = xy[1] > 0 ? std::min(xy[1], bottom) : 0.0f;
  const int64_t x0 = static_cast<int64_t>(x);
  const int64_t y0 = static_cast<int64_t>(y);
  const int64_t x1 = std::min(x0 + 1, map.width - 1);
  const int64_t y1 = std::min(y0 + 1, map.height - 1);
  const float fx = x - static_cast<float>(x0);
  const float fy = y - static_cast<float>(y0);
  return {{y0 * map.width + x0, y0 * map.width + x1, y1 * map.width + x0, y1 * map.width + x1},
          {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

template <int64_t, typename T>
HOLDFAST_INLINE void Sample(const SampledRows& rows, T, int64_t begin, int64_t end) {
  const RowMaps& m = rows.maps;
  for (int64_t i = begin; i < end; ++i) {
    const int64_t item = ItemAt(m, i);
    const MapView& map = m.At(item / m.frames, item % m.frames)[0];
    const Corners at = CornersAt(rows.xy + item * 2, map);
    const T* data = static_cast<const T*>(map.data);
    const T* __restrict p0 = data + at.cells[0] * m.channels;
    const T* __restrict p1 = data + at.cells[1] * m.channels;
    const T* __restrict p2 = data + at.cells[2] * m.channels;
    const T* __restrict p3 = data + at.cells[3] * m.channels;
    float* __restrict out = rows.out + item * m.channels;
    for (int64_t c = 0; c < m.channels; ++c) {
      out[c] = at.weights[0] * ToFloat(p0[c]) + at.weights[1] * ToFloat(p1[c]) + at.weights[2] * ToFloat(p2[c]) +
               at.weights[3] * ToFloat(p3[c]);
    }
  }
}

template <int64_t>
HOLDFAST_INLINE void SampleBackward(const SampledRows& rows, int64_t begin, int64_t end) {
  const RowMaps& m = rows.maps;
  for (int64_t frame = begin; frame < end; ++frame) {
    const MapView& map = rows.grad_maps[frame * m.levels];
    for (int64_t row = 0; row < m.rows; ++row) {
      const int64_t item = row * m.frames + frame;
      const Corners at = CornersAt(rows.xy + item * 2, map);
      const float* __restrict grad = rows.grad_out + item * m.channels;
      for (int i = 0; i < 4; ++i) {
        float* __restrict cell = static_cast<float*>(map.data) + at.cells[i] * m.channels;
        for (int64_t c = 0; c < m.channels; ++c) cell[c] += at.weights[i] * grad[c];
      }
    }
  }
}

}  // namespace

HOLDFAST_KERNEL(CorrelateItems, (const CorrelationRows& rows, float type, int64_t begin, int64_t end), Correlate,
                (rows, type, begin, end))
HOLDFAST_KERNEL(CorrelateItems, (const CorrelationRows& rows, Bf16 type, int64_t begin, int64_t end), Correlate,
                (rows, type, begin, end))
HOLDFAST_KERNEL(CorrelateFramesBackward, (const CorrelationRows& rows, float type, int64_t begin, int64_t end),
                CorrelateBackward, (rows, type, begin, end))
HOLDFAST_KERNEL(CorrelateFramesBackward, (const CorrelationRows& rows, Bf16 type, int64_t begin, int64_t end),
                CorrelateBackward, (rows, type, begin, end))
HOLDFAST_KERNEL(SampleItems, (const SampledRows& rows, float type, int64_t begin, int64_t end), Sample,
                (rows, type, begin, end))
HOLDFAST_KERNEL(SampleItems, (const SampledRows& rows, Bf16 type, int64_t begin, int64_t end), Sample,
                (rows, type, begin, end))
HOLDFAST_KERNEL(SampleFramesBackward, (const SampledRows& rows, int64_t begin, int64_t end), SampleBackward,
                (rows, begin, end))

}  // namespace holdfast
