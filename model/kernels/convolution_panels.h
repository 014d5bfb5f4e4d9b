// SPDX-License-Identifier: Apache-2.0
// Products of rows of a map with panels of weights, for convolution.cc: every convolution comes down to these. Included
// by kernels alone.
#pragma once

#include <algorithm>
#include <cstdint>

#include "model/kernels/convolution.h"
#include "model/kernels/simd.h"

namespace holdfast::convolution {

// The weights of a chunk are to stay in the first-level cache.
constexpr int64_t kChunkFloats = int64_t{6} * 1024;
constexpr int64_t kMaxPixels = 6;
constexpr int64_t kLineFloats = 16;       // of the caches
constexpr int64_t kPrefetchedLines = 16;  // by a tile
constexpr int64_t kMaxPanel = 3 * kMaxLanes;

// A panel is what one pass over the rows computes: some registers of channels.
template <int64_t kWidth>
HOLDFAST_INLINE int64_t PanelChannels(int64_t out_channels) {
  return out_channels % (3 * kWidth) == 0 ? 3 * kWidth : 2 * kWidth;
}

HOLDFAST_INLINE int64_t Depth(const ConvolutionMaps& m) { return m.kernel_height * m.kernel_width * m.channels; }

// A square of four rows, 'step' floats apart, becomes one of four columns.
HOLDFAST_INLINE void TransposeSquare(const float* from, int64_t step, float* to, int64_t to_step) {
  const Lanes<4> a = Load<4>(from), b = Load<4>(from + step), c = Load<4>(from + 2 * step),
                 d = Load<4>(from + 3 * step);
  const Lanes<4> ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
  const Lanes<4> ab2 = __builtin_shufflevector(a, b, 2, 6, 3, 7), cd2 = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  Store(__builtin_shufflevector(ab, cd, 0, 1, 4, 5), to);
  Store(__builtin_shufflevector(ab, cd, 2, 3, 6, 7), to + to_step);
  Store(__builtin_shufflevector(ab2, cd2, 0, 1, 4, 5), to + 2 * to_step);
  Store(__builtin_shufflevector(ab2, cd2, 2, 3, 6, 7), to + 3 * to_step);
}

// to[k, o] = from[o, k] for k below 'depth' and o below 'used', which leaves the rest of a row of 'panel' alone; rows
// of 'from' begin 'step' floats apart.
HOLDFAST_INLINE void Transpose(const float* from, int64_t step, int64_t depth, int64_t used, float* to, int64_t panel) {
  constexpr int64_t kBlock = 64;  // so much of a row is read at once
  const int64_t squares = used / 4 * 4, whole = depth / 4 * 4;
  for (int64_t first = 0; first < whole; first += kBlock) {
    for (int64_t o = 0; o < squares; o += 4) {
      for (int64_t k = first; k < std::min(first + kBlock, whole); k += 4) {
        TransposeSquare(from + o * step + k, step, to + k * panel + o, panel);
      }
    }
  }
  for (int64_t o = 0; o < used; ++o) {
    for (int64_t k = o < squares ? whole : 0; k < depth; ++k) to[k * panel + o] = from[o * step + k];
  }
}

HOLDFAST_INLINE void PackBias(const ConvolutionMaps& m, int64_t first, int64_t used, float* to) {
  for (int64_t o = 0; o < used; ++o) to[o] = m.bias == nullptr ? 0.0f : m.bias[first + o];
}

// Rows of the input that a group of rows of the result needs, with zeros around them, and room for its sums.
struct Rows {
  float* first;
  int64_t floats;  // from one row to the next
  float* sums;     // [rows of the group, tiles, pixels, panel]
};

// Inputs [first, first + count) of 'lines' lines of the kernel, one line's inputs being neighbours in a row of the
// input.
struct Chunk {
  int64_t line, lines;
  int64_t first, count;
};

// Adds a chunk's products to the sums of kPixels pixels of a row and a panel of kVectors registers.
template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void Multiply(const float* x, int64_t row_floats, int64_t step, const Chunk& chunk, int64_t line_inputs,
                              const float* weights, Lanes<kWidth> (&sums)[kPixels][kVectors]) {
  using V = Lanes<kWidth>;
  for (int64_t line = 0; line < chunk.lines; ++line) {
    const float* at = x + (chunk.line + line) * row_floats + chunk.first;
    const float* w = weights + ((chunk.line + line) * line_inputs + chunk.first) * kVectors * kWidth;
    for (int64_t k = 0; k < chunk.count; ++k, w += kVectors * kWidth) {
      V weight[kVectors];
      for (int64_t v = 0; v < kVectors; ++v) weight[v] = Load<kWidth>(w + v * kWidth);
      for (int64_t i = 0; i < kPixels; ++i) {
        const float value = at[i * step + k];
        for (int64_t v = 0; v < kVectors; ++v) sums[i][v] += value * weight[v];
      }
    }
  }
}

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
struct PanelWork {
  const ConvolutionMaps& m;
  const Rows& rows;
  const float* packed;  // bias and weights of the panel
  int64_t first;        // channel
  float* y;             // of the group's first row
};

// Where sums lie between chunks, or go in the end.
struct Place {
  float* data;
  int64_t step;  // floats from pixel to pixel
};

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void StoreSums(const Lanes<kWidth> (&sums)[kPixels][kVectors], const Place& place) {
  for (int64_t i = 0; i < kPixels; ++i) {
    for (int64_t v = 0; v < kVectors; ++v) Store(sums[i][v], place.data + i * place.step + v * kWidth);
  }
}

// A part of the weights behind a chunk's, so that the next chunk, which is as large, finds them in the second-level
// cache.
HOLDFAST_INLINE void PrefetchPart(const float* weights, int64_t part, int64_t floats) {
  if (part * kPrefetchedLines * kLineFloats >= floats) return;
  for (int64_t i = 0; i < kPrefetchedLines; ++i) {
    __builtin_prefetch(weights + (part * kPrefetchedLines + i) * kLineFloats, 0, 2);
  }
}

// One chunk of one tile: pixels pixel ... pixel + kPixels - 1 of a row of the group.
template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunTile(const PanelWork<kWidth, kPixels, kVectors>& work, const Chunk& chunk, int64_t row,
                             int64_t pixel) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const ConvolutionMaps& m = work.m;
  const int64_t line_inputs = m.kernel_width * m.channels;
  const int64_t step = m.stride * m.channels;
  const float* x = work.rows.first + row * m.stride * work.rows.floats + pixel * step;
  const Place kept = {work.rows.sums + (row * RoundUp(m.out_width, kPixels) + pixel) * kPanel, kPanel};
  Lanes<kWidth> sums[kPixels][kVectors];
  const bool begins = chunk.line == 0 && chunk.first == 0;
  for (int64_t i = 0; i < kPixels; ++i) {
    for (int64_t v = 0; v < kVectors; ++v) {
      sums[i][v] = Load<kWidth>((begins ? work.packed : kept.data + i * kPanel) + v * kWidth);
    }
  }
  Multiply<kWidth, kPixels, kVectors>(x, work.rows.floats, step, chunk, line_inputs, work.packed + kPanel, sums);
  if (chunk.line + chunk.lines < m.kernel_height || chunk.first + chunk.count < line_inputs) {
    return StoreSums<kWidth, kPixels, kVectors>(sums, kept);
  }
  const Place out = {work.y + (row * m.out_width + pixel) * m.out_channels + work.first, m.out_channels};
  const int64_t pixels = std::min(kPixels, m.out_width - pixel);
  const int64_t channels = std::min(kPanel, m.out_channels - work.first);
  if (pixels == kPixels && channels == kPanel) return StoreSums<kWidth, kPixels, kVectors>(sums, out);
  StoreSums<kWidth, kPixels, kVectors>(sums, kept);
  for (int64_t i = 0; i < pixels; ++i) std::copy_n(kept.data + i * kPanel, channels, out.data + i * out.step);
}

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunChunk(const PanelWork<kWidth, kPixels, kVectors>& work, const Chunk& chunk, int64_t rows) {
  const int64_t line_inputs = work.m.kernel_width * work.m.channels;
  const int64_t done = (chunk.line + chunk.lines - 1) * line_inputs + chunk.first + chunk.count;
  const int64_t floats = chunk.lines * chunk.count * kVectors * kWidth;
  int64_t tile = 0;
  for (int64_t row = 0; row < rows; ++row) {
    for (int64_t pixel = 0; pixel < work.m.out_width; pixel += kPixels) {
      PrefetchPart(work.packed + (1 + done) * kVectors * kWidth, tile++, floats);
      RunTile<kWidth, kPixels, kVectors>(work, chunk, row, pixel);
    }
  }
}

// All chunks of a panel: lines together where they are short, parts of a line where it is long.
template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunPanel(const PanelWork<kWidth, kPixels, kVectors>& work, int64_t rows) {
  const int64_t line_inputs = work.m.kernel_width * work.m.channels;
  const int64_t inputs = kChunkFloats / (kVectors * kWidth);
  const int64_t lines = std::max<int64_t>(1, inputs / line_inputs);
  for (int64_t line = 0; line < work.m.kernel_height; line += lines) {
    for (int64_t first = 0; first < line_inputs; first += inputs) {
      const Chunk chunk = {line, std::min(lines, work.m.kernel_height - line), first,
                           std::min(inputs, line_inputs - first)};
      RunChunk<kWidth, kPixels, kVectors>(work, chunk, rows);
    }
  }
}

}  // namespace holdfast::convolution
