// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/convolution.h"

#include <algorithm>

#include "model/kernels/norm_blocks.h"
#include "model/kernels/simd.h"

namespace holdfast {
namespace {

// The input's rows of a group are to stay in the second-level cache, the weights of a chunk in the first.
constexpr int64_t kGroupFloats = 48 * 1024;
constexpr int64_t kChunkFloats = 6 * 1024;
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

// to[k, o] = from[o, k] for k below 'depth' and o below 'used', which leaves the rest of a row of 'panel' alone.
HOLDFAST_INLINE void Transpose(const float* from, int64_t depth, int64_t used, float* to, int64_t panel) {
  constexpr int64_t kBlock = 64;  // so much of a row is read at once
  const int64_t squares = used / 4 * 4, whole = depth / 4 * 4;
  for (int64_t first = 0; first < whole; first += kBlock) {
    for (int64_t o = 0; o < squares; o += 4) {
      for (int64_t k = first; k < std::min(first + kBlock, whole); k += 4) {
        TransposeSquare(from + o * depth + k, depth, to + k * panel + o, panel);
      }
    }
  }
  for (int64_t o = 0; o < used; ++o) {
    for (int64_t k = o < squares ? whole : 0; k < depth; ++k) to[k * panel + o] = from[o * depth + k];
  }
}

// Panel after panel: the bias, then for each of the Depth inputs the weights of its channels.
template <int64_t kWidth>
HOLDFAST_INLINE void Pack(const ConvolutionMaps& m) {
  const int64_t panel = PanelChannels<kWidth>(m.out_channels);
  const int64_t depth = Depth(m);
  float* to = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += panel, to += (depth + 1) * panel) {
    const int64_t used = std::min(panel, m.out_channels - first);
    if (used < panel) std::fill_n(to, (depth + 1) * panel, 0.0f);
    for (int64_t o = 0; o < used; ++o) to[o] = m.bias == nullptr ? 0.0f : m.bias[first + o];
    Transpose(m.weights + first * depth, depth, used, to + panel, panel);
  }
}

// Rows of the input, with zeros around them, that a group of rows of the result needs; and room for its sums.
struct Padded {
  float* rows;
  float* sums;         // [rows of the group, tiles, pixels, panel]
  int64_t row_floats;  // from one row to the next
};

HOLDFAST_INLINE int64_t RowFloats(const ConvolutionMaps& m) {
  return (m.width + 2 * (m.kernel_width / 2)) * m.channels;
}

// Rows of a map that has nothing above and below are rows of one tall map.
HOLDFAST_INLINE ConvolutionMaps AsOneMap(ConvolutionMaps m) {
  if (m.kernel_height > 1 || m.stride > 1) return m;
  m.height *= m.images;
  m.out_height *= m.images;
  m.images = 1;
  return m;
}

// relu(norm(x)) of a row of the input.
template <int64_t kWidth>
HOLDFAST_INLINE void NormRow(const float* x, int64_t pixels, int64_t channels, const float* moments, float* out) {
  using V = Lanes<kWidth>;
  const float* rstd = moments + channels;
  for (int64_t i = 0; i < pixels; ++i, x += channels, out += channels) {
    int64_t c = 0;
    for (; c + kWidth <= channels; c += kWidth) {
      Store(Max((Load<kWidth>(x + c) - Load<kWidth>(moments + c)) * Load<kWidth>(rstd + c), V{}), out + c);
    }
    for (; c < channels; ++c) out[c] = std::max((x[c] - moments[c]) * rstd[c], 0.0f);
  }
}

// The rows that [first, first + count) of the rows of one map's result need; 'image_rows' are a row of moments' rows.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherRows(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t first,
                                int64_t count, const Padded& padded) {
  const int64_t margin = m.kernel_width / 2 * m.channels;
  const int64_t values = m.width * m.channels;
  const int64_t top = first * m.stride - m.kernel_height / 2;
  float* row = padded.rows;
  for (int64_t i = 0; i < (count - 1) * m.stride + m.kernel_height; ++i, row += padded.row_floats) {
    const int64_t y = top + i;
    if (y < 0 || y >= m.height) {
      std::fill_n(row, padded.row_floats, 0.0f);
      continue;
    }
    const int64_t place = image * m.height + y;
    std::fill_n(row, margin, 0.0f);
    if (m.moments == nullptr) {
      std::copy_n(m.x + place * values, values, row + margin);
    } else {
      const float* moments = m.moments + place / image_rows * 2 * m.channels;
      NormRow<kWidth>(m.x + place * values, m.width, m.channels, moments, row + margin);
    }
    std::fill_n(row + margin + values, margin, 0.0f);
  }
}

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
  const Padded& padded;
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

// A part of the weights behind a chunk's, so that the next chunk finds them in the second-level cache.
HOLDFAST_INLINE void PrefetchPart(const float* weights, int64_t part) {
  if (part * kPrefetchedLines * kLineFloats >= kChunkFloats) return;
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
  const float* x = work.padded.rows + row * m.stride * work.padded.row_floats + pixel * step;
  const Place kept = {work.padded.sums + (row * RoundUp(m.out_width, kPixels) + pixel) * kPanel, kPanel};
  Lanes<kWidth> sums[kPixels][kVectors];
  const bool begins = chunk.line == 0 && chunk.first == 0;
  for (int64_t i = 0; i < kPixels; ++i) {
    for (int64_t v = 0; v < kVectors; ++v) {
      sums[i][v] = Load<kWidth>((begins ? work.packed : kept.data + i * kPanel) + v * kWidth);
    }
  }
  Multiply<kWidth, kPixels, kVectors>(x, work.padded.row_floats, step, chunk, line_inputs, work.packed + kPanel, sums);
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
  int64_t tile = 0;
  for (int64_t row = 0; row < rows; ++row) {
    for (int64_t pixel = 0; pixel < work.m.out_width; pixel += kPixels) {
      PrefetchPart(work.packed + (1 + done) * kVectors * kWidth, tile++);
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

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunGroup(const ConvolutionMaps& m, const Padded& padded, float* y, int64_t rows) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const float* packed = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += kPanel, packed += (Depth(m) + 1) * kPanel) {
    RunPanel<kWidth, kPixels, kVectors>({m, padded, packed, first, y}, rows);
  }
}

// Of rows that have just been written, while they are in the cache.
HOLDFAST_INLINE void TakeMoments(const ConvolutionMaps& m, const float* y, int64_t row, int64_t rows) {
  for (int64_t i = 0; i < rows; ++i) {
    float* mean = m.partial + (row + i) * 2 * m.out_channels;
    Moments(y + i * m.out_width * m.out_channels, m.out_width, m.out_channels, mean, mean + m.out_channels);
  }
}

template <int64_t kWidth>
HOLDFAST_INLINE void ConvolveGroups(const ConvolutionMaps& maps, float* scratch, int64_t begin, int64_t end) {
  const ConvolutionMaps m = AsOneMap(maps);
  const int64_t group = maps.group_rows();
  const int64_t input_rows = (group - 1) * m.stride + m.kernel_height;
  // Tiles may reach beyond the last row's end.
  const int64_t slack = (kMaxPixels * m.stride + m.kernel_width) * m.channels;
  const Padded padded = {scratch, scratch + input_rows * RowFloats(m) + slack, RowFloats(m)};
  std::fill_n(scratch, input_rows * padded.row_floats + slack, 0.0f);
  int64_t rows = 0;
  for (int64_t row = begin; row < end; row += rows) {
    const int64_t image = row / m.out_height;
    const int64_t y = row % m.out_height;
    rows = std::min({group, m.out_height - y, end - row});
    GatherRows<kWidth>(m, maps.height, image, y, rows, padded);
    float* out = m.y + row * m.out_width * m.out_channels;
    // Twelve sums and what is multiplied fill sixteen registers.
    if (PanelChannels<kWidth>(m.out_channels) == 3 * kWidth) {
      RunGroup<kWidth, 4, 3>(m, padded, out, rows);
    } else {
      RunGroup<kWidth, 6, 2>(m, padded, out, rows);
    }
    if (m.partial != nullptr) TakeMoments(m, out, row, rows);
  }
}

}  // namespace

int64_t ConvolutionMaps::packed_floats() const { return (Depth(*this) + 1) * (out_channels + kMaxPanel); }

int64_t ConvolutionMaps::group_rows() const {
  return std::clamp<int64_t>(kGroupFloats / (RowFloats(*this) * stride), 1, rows());
}

int64_t ConvolutionMaps::scratch_floats() const {
  const int64_t input_rows = (group_rows() - 1) * stride + kernel_height;
  return input_rows * RowFloats(*this) + (kMaxPixels * stride + kernel_width) * channels +
         group_rows() * (out_width + kMaxPixels) * kMaxPanel;
}

HOLDFAST_KERNEL(PackWeights, (const ConvolutionMaps& maps), Pack, (maps))
HOLDFAST_KERNEL(ConvolveRows, (const ConvolutionMaps& maps, float* scratch, int64_t begin, int64_t end), ConvolveGroups,
                (maps, scratch, begin, end))

}  // namespace holdfast
