// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/convolution.h"

#include <algorithm>

#include "model/kernels/convolution_panels.h"
#include "model/kernels/convolution_terms.h"
#include "model/kernels/norm_blocks.h"
#include "model/kernels/simd.h"

namespace holdfast {
namespace convolution {
namespace {

// The input's rows of a group are to stay in the second-level cache; of their terms one is looked at at a time.
constexpr int64_t kGroupFloats = 48 * 1024;
constexpr int64_t kGroupTermFloats = 96 * 1024;

// Panel after panel: the bias, then for each of the Depth inputs the weights of its channels; or that of each term.
template <int64_t kWidth>
HOLDFAST_INLINE void Pack(const ConvolutionMaps& m) {
  const int64_t panel = PanelChannels<kWidth>(m.out_channels);
  const int64_t depth = Depth(m);
  const int64_t floats = TakesTerms(m) ? kTerms * (depth / 3 + 1) * panel : (depth + 1) * panel;
  float* to = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += panel, to += floats) {
    const int64_t used = std::min(panel, m.out_channels - first);
    if (TakesTerms(m)) {
      PackTerms<kWidth>(m, first, used, panel, to);
      continue;
    }
    if (used < panel) std::fill_n(to, floats, 0.0f);
    PackBias(m, first, used, to);
    Transpose(m.weights + first * depth, depth, depth, used, to + panel, panel);
  }
}

// Scratch memory of a thread.
struct Scratch {
  Rows rows;       // of the input, or their terms
  float* line;     // where there are terms: a row of the input
  float* results;  // [kTerms, rows of the group, pairs, panel]
};

HOLDFAST_INLINE int64_t RowFloats(const ConvolutionMaps& m) {
  if (TakesTerms(m)) return TermFloats(m);
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

// One row of the input, normed where that is asked for, with zeros on both sides: 'floats' in all.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherRow(const ConvolutionMaps& m, int64_t row, int64_t image, int64_t floats, float* out) {
  const int64_t margin = m.kernel_width / 2 * m.channels;
  const int64_t values = m.width * m.channels;
  const float* x = m.x + row * values;
  std::fill_n(out, margin, 0.0f);
  if (m.moments == nullptr) {
    std::copy_n(x, values, out + margin);
  } else {
    NormRow<kWidth>(x, m.width, m.channels, m.moments + image * 2 * m.channels, out + margin);
  }
  std::fill_n(out + margin + values, floats - margin - values, 0.0f);
}

// The rows that [first, first + count) of the rows of one map's result need; 'image_rows' are a row of moments' rows.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherRows(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t first,
                                int64_t count, const Scratch& scratch) {
  const int64_t top = first * m.stride - m.kernel_height / 2;
  float* row = scratch.rows.first;
  for (int64_t i = 0; i < (count - 1) * m.stride + m.kernel_height; ++i, row += scratch.rows.floats) {
    const int64_t y = top + i;
    const int64_t place = image * m.height + y;
    if (y < 0 || y >= m.height) {
      std::fill_n(row, scratch.rows.floats, 0.0f);
    } else if (TakesTerms(m)) {
      GatherRow<kWidth>(m, place, place / image_rows, LineFloats(m), scratch.line);
      MakeTerms<kWidth>(scratch.line, Pairs(m), m.channels, row);
    } else {
      GatherRow<kWidth>(m, place, place / image_rows, scratch.rows.floats, row);
    }
  }
}

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunGroup(const ConvolutionMaps& m, const Scratch& scratch, float* y, int64_t rows) {
  if (TakesTerms(m)) return RunTerms<kWidth, kPixels, kVectors>(m, scratch.rows, scratch.results, y, rows);
  constexpr int64_t kPanel = kVectors * kWidth;
  const float* packed = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += kPanel, packed += (Depth(m) + 1) * kPanel) {
    RunPanel<kWidth, kPixels, kVectors>({m, scratch.rows, packed, first, y}, rows);
  }
}

// Of rows that have just been written, while they are in the cache.
HOLDFAST_INLINE void TakeMoments(const ConvolutionMaps& m, const float* y, int64_t row, int64_t rows) {
  for (int64_t i = 0; i < rows; ++i) {
    float* mean = m.partial + (row + i) * 2 * m.out_channels;
    Moments(y + i * m.out_width * m.out_channels, m.out_width, m.out_channels, mean, mean + m.out_channels);
  }
}

// Floats of a group's rows of the input. Tiles may reach beyond the last row's end.
HOLDFAST_INLINE int64_t GroupFloats(const ConvolutionMaps& m, int64_t group) {
  const int64_t input_rows = (group - 1) * m.stride + m.kernel_height;
  return input_rows * RowFloats(m) + (kMaxPixels * m.stride + m.kernel_width) * m.channels;
}

HOLDFAST_INLINE int64_t SumFloats(const ConvolutionMaps& m, int64_t group) {
  return group * (m.out_width + kMaxPixels) * kMaxPanel;
}

HOLDFAST_INLINE Scratch Divide(const ConvolutionMaps& m, int64_t group, float* memory) {
  Scratch scratch = {{memory, RowFloats(m), memory + GroupFloats(m, group)}, nullptr, nullptr};
  if (TakesTerms(m)) {
    scratch.line = scratch.rows.sums + SumFloats(m, group);
    scratch.results = scratch.line + LineFloats(m);
  }
  return scratch;
}

template <int64_t kWidth>
HOLDFAST_INLINE void ConvolveGroups(const ConvolutionMaps& maps, float* memory, int64_t begin, int64_t end) {
  const ConvolutionMaps m = AsOneMap(maps);
  const int64_t group = maps.group_rows();
  const Scratch scratch = Divide(m, group, memory);
  std::fill(memory, scratch.rows.sums, 0.0f);
  int64_t rows = 0;
  for (int64_t row = begin; row < end; row += rows) {
    const int64_t image = row / m.out_height;
    const int64_t y = row % m.out_height;
    rows = std::min({group, m.out_height - y, end - row});
    GatherRows<kWidth>(m, maps.height, image, y, rows, scratch);
    float* out = m.y + row * m.out_width * m.out_channels;
    // Twelve sums and what is multiplied fill sixteen registers.
    if (PanelChannels<kWidth>(m.out_channels) == 3 * kWidth) {
      RunGroup<kWidth, 4, 3>(m, scratch, out, rows);
    } else {
      RunGroup<kWidth, 6, 2>(m, scratch, out, rows);
    }
    if (m.partial != nullptr) TakeMoments(m, out, row, rows);
  }
}

}  // namespace
}  // namespace convolution

int64_t ConvolutionMaps::packed_floats() const {
  using namespace convolution;
  const int64_t a_channel = TakesTerms(*this) ? kTerms * (Depth(*this) / 3 + 1) : Depth(*this) + 1;
  return a_channel * (out_channels + kMaxPanel);
}

int64_t ConvolutionMaps::group_rows() const {
  using namespace convolution;
  const int64_t floats = TakesTerms(*this) ? kGroupTermFloats : kGroupFloats;
  return std::clamp<int64_t>(floats / (RowFloats(*this) * stride), 1, rows());
}

int64_t ConvolutionMaps::scratch_floats() const {
  using namespace convolution;
  const int64_t group = group_rows();
  const int64_t floats = GroupFloats(*this, group) + SumFloats(*this, group);
  if (!TakesTerms(*this)) return floats;
  return floats + LineFloats(*this) + kTerms * group * Pairs(*this) * kMaxPanel;
}

HOLDFAST_KERNEL(PackWeights, (const ConvolutionMaps& maps), convolution::Pack, (maps))
HOLDFAST_KERNEL(ConvolveRows, (const ConvolutionMaps& maps, float* scratch, int64_t begin, int64_t end),
                convolution::ConvolveGroups, (maps, scratch, begin, end))

}  // namespace holdfast
