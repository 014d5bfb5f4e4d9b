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

// The input's rows of a group are to stay in the second-level cache. Of terms one in six, or in 24, is looked at at a
// time; weights are read once a group.
constexpr int64_t kGroupFloats = int64_t{48} * 1024;
constexpr int64_t kGroupTermFloats = int64_t{128} * 1024;
constexpr int64_t kGroupQuads = 128;  // at least: where they are too many for the cache, so are the weights

// Panel after panel: the bias, then for each of the Depth inputs the weights of its channels; or those of the terms.
template <int64_t kWidth>
HOLDFAST_INLINE void Pack(const ConvolutionMaps& m) {
  const int64_t panel = PanelChannels<kWidth>(m.out_channels);
  const int64_t depth = Depth(m);
  const int64_t floats = TakesTerms(m) ? PanelTermFloats(m, panel) : (depth + 1) * panel;
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
  Rows rows;       // of the input
  int64_t step;    // where there are terms: of the group, [terms, step] in place of the input's rows;
  float* line;     // a row of the input;
  float* terms;    // [4, kTerms, quads, C], those of the last rows for terms of lines: row y is at y % 4;
  float* results;  // [terms, parts of the group, quads, panel]
};

HOLDFAST_INLINE int64_t RowFloats(const ConvolutionMaps& m) {
  return TakesTerms(m) ? PartTerms(m) * TermFloats(m) : (m.width + 2 * (m.kernel_width / 2)) * m.channels;
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
  const float* rstd = moments + channels;
  for (int64_t i = 0; i < pixels; ++i, x += channels, out += channels) {
    int64_t c = 0;
    for (; c + kWidth <= channels; c += kWidth) {
      Store(Relu((Load<kWidth>(x + c) - Load<kWidth>(moments + c)) * Load<kWidth>(rstd + c)), out + c);
    }
    for (; c < channels; ++c) out[c] = Relu((x[c] - moments[c]) * rstd[c]);
  }
}

// One row of the input, normed where that is asked for, with zeros on both sides: 'floats' in all.
template <int64_t kWidth>
HOLDFAST_INLINE void CopyRow(const ConvolutionMaps& m, int64_t row, int64_t image, int64_t floats, float* out) {
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

// Row y of a map, which may lie above or below it; 'image_rows' are a row of moments' rows.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherRow(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t y, int64_t floats,
                               float* out) {
  if (y < 0 || y >= m.height) {
    std::fill_n(out, floats, 0.0f);
    return;
  }
  const int64_t row = image * m.height + y;
  CopyRow<kWidth>(m, row, row / image_rows, floats, out);
}

// The terms of one row of the input, kTerms times [quads, C], one 'step' floats behind the other.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherTermsOfRow(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t y,
                                      int64_t step, const Scratch& scratch, float* out) {
  GatherRow<kWidth>(m, image_rows, image, y, LineFloats(m), scratch.line);
  MakeTermsOfLine<kWidth>(scratch.line, Quads(m), m.channels, step, out);
}

// The terms of parts [first, first + count) of one map's result, and of the rows that the kernel reaches around them.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherTerms(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t first,
                                 int64_t count, const Scratch& scratch) {
  float* to = scratch.rows.first;
  for (int64_t i = 0; i < count + TermHeight(m) - 1; ++i, to += TermFloats(m)) {
    GatherTermsOfRow<kWidth>(m, image_rows, image, first + i - m.kernel_height / 2, scratch.step, scratch, to);
  }
}

// The same of lines that take terms, too.
template <int64_t kWidth>
HOLDFAST_INLINE void GatherTermsOfLines(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t first,
                                        int64_t count, const Scratch& scratch) {
  float* part = scratch.rows.first;
  for (int64_t i = 0; i < count; ++i, part += TermFloats(m)) {
    const float* rows[kLineTerms];
    for (int64_t k = 0; k < kLineTerms; ++k) {
      const int64_t y = 2 * (first + i) - 1 + k;
      float* terms = scratch.terms + (y + kLineTerms) % kLineTerms * kTerms * TermFloats(m);
      rows[k] = terms;
      if (i > 0 && k < 2) continue;  // of the part before
      GatherTermsOfRow<kWidth>(m, image_rows, image, y, TermFloats(m), scratch, terms);
    }
    float* to = part;
    for (int64_t j = 0; j < kTerms; ++j, to += scratch.step) {
      MakeTerms<kWidth>(rows, TermFloats(m), kTerms * scratch.step, to);
      for (const float*& row : rows) row += TermFloats(m);
    }
  }
}

// What parts [first, first + count) of one map's result need of the input.
template <int64_t kWidth>
HOLDFAST_INLINE void Gather(const ConvolutionMaps& m, int64_t image_rows, int64_t image, int64_t first, int64_t count,
                            const Scratch& scratch) {
  if (TakesTermsOfLines(m)) return GatherTermsOfLines<kWidth>(m, image_rows, image, first, count, scratch);
  if (TakesTerms(m)) return GatherTerms<kWidth>(m, image_rows, image, first, count, scratch);
  const int64_t top = first * m.stride - m.kernel_height / 2;
  for (int64_t i = 0; i < (count - 1) * m.stride + m.kernel_height; ++i) {
    float* row = scratch.rows.first + i * scratch.rows.floats;
    GatherRow<kWidth>(m, image_rows, image, top + i, scratch.rows.floats, row);
  }
}

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunGroup(const ConvolutionMaps& m, const Scratch& scratch, float* y, int64_t rows) {
  if (TakesTerms(m)) {
    return RunTerms<kWidth, kPixels, kVectors>(m, scratch.rows, scratch.step, scratch.results, y, rows);
  }
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

// Floats of what a group of parts needs of the input. Tiles may reach beyond the last row's end.
HOLDFAST_INLINE int64_t GroupFloats(const ConvolutionMaps& m, int64_t group) {
  const int64_t slack = (kMaxPixels * m.stride + m.kernel_width) * m.channels;
  if (TakesTerms(m)) return PartTerms(m) * GroupTermFloats(m, group) + slack;
  return ((group - 1) * m.stride + m.kernel_height) * RowFloats(m) + slack;
}

HOLDFAST_INLINE int64_t SumFloats(const ConvolutionMaps& m, int64_t group) {
  return (TakesTerms(m) ? group * Quads(m) + kMaxPixels : group * (m.out_width + kMaxPixels)) * kMaxPanel;
}

HOLDFAST_INLINE Scratch Divide(const ConvolutionMaps& m, int64_t group, float* memory) {
  Scratch scratch = {{memory, RowFloats(m), memory + GroupFloats(m, group)}, 0, nullptr, nullptr, nullptr};
  if (TakesTerms(m)) {
    scratch.step = GroupTermFloats(m, group);
    scratch.line = scratch.rows.sums + SumFloats(m, group);
    scratch.terms = scratch.line + LineFloats(m);
    scratch.results = scratch.terms + kLineTerms * kTerms * TermFloats(m);
  }
  return scratch;
}

HOLDFAST_INLINE int64_t PartsOfImage(const ConvolutionMaps& m) { return PartsOf(m, m.out_height); }

template <int64_t kWidth>
HOLDFAST_INLINE void ConvolveGroups(const ConvolutionMaps& maps, float* memory, int64_t begin, int64_t end) {
  const ConvolutionMaps m = AsOneMap(maps);
  const int64_t group = maps.group_parts();
  const Scratch scratch = Divide(m, group, memory);
  std::fill(memory, scratch.rows.sums, 0.0f);
  int64_t count = 0;
  for (int64_t part = begin; part < end; part += count) {
    const int64_t image = part / PartsOfImage(m);
    const int64_t first = part % PartsOfImage(m);
    count = std::min({group, PartsOfImage(m) - first, end - part});
    Gather<kWidth>(m, maps.height, image, first, count, scratch);
    const int64_t y = first * PartLines(m), row = image * m.out_height + y;
    const int64_t rows = std::min(count * PartLines(m), m.out_height - y);
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

int64_t ConvolutionMaps::parts() const { return images * convolution::PartsOfImage(*this); }

int64_t ConvolutionMaps::packed_floats() const {
  using namespace convolution;
  const int64_t channels_at_most = out_channels + kMaxPanel;
  return TakesTerms(*this) ? PanelTermFloats(*this, channels_at_most) : (Depth(*this) + 1) * channels_at_most;
}

int64_t ConvolutionMaps::group_parts() const {
  using namespace convolution;
  if (!TakesTerms(*this)) return std::clamp<int64_t>(kGroupFloats / (RowFloats(*this) * stride), 1, parts());
  const int64_t fit = std::max(kGroupTermFloats / RowFloats(*this), kGroupQuads / Quads(*this));
  return std::clamp<int64_t>(fit, 1, parts());
}

int64_t ConvolutionMaps::scratch_floats() const {
  using namespace convolution;
  const int64_t group = group_parts();
  const int64_t floats = GroupFloats(*this, group) + SumFloats(*this, group);
  if (!TakesTerms(*this)) return floats;
  const int64_t results = PartTerms(*this) * group * Quads(*this) * kMaxPanel;
  return floats + LineFloats(*this) + kLineTerms * kTerms * TermFloats(*this) + results;
}

HOLDFAST_KERNEL(PackWeights, (const ConvolutionMaps& maps), convolution::Pack, (maps))
HOLDFAST_KERNEL(ConvolveParts, (const ConvolutionMaps& maps, float* scratch, int64_t begin, int64_t end),
                convolution::ConvolveGroups, (maps, scratch, begin, end))

}  // namespace holdfast
