// SPDX-License-Identifier: Apache-2.0
// Winograd's F(2, 3) for convolution.cc (Winograd 1980; Lavin and Gray 2016): two neighbours in a row, which kernels
// three pixels wide make of four pixels d by six products a channel, are made of four, the terms:
//   m0 = (d0 - d2) g0, m1 = (d1 + d2) (g0 + g1 + g2) / 2, m2 = (d2 - d1) (g0 - g1 + g2) / 2, m3 = (d1 - d3) g2
//   y0 = m0 + m1 + m2, y1 = m1 - m2 - m3
// Kernels of three lines take terms of those terms, of four rows: a square of four pixels costs sixteen products,
// not 36. A part of the result is a row, or two rows of a map. Included by kernels alone.
#pragma once

#include <algorithm>
#include <cstdint>

#include "model/kernels/convolution_panels.h"

namespace holdfast::convolution {

constexpr int64_t kTerms = 4;
constexpr int64_t kTermChannels = 32;  // with fewer, making terms costs what they save

HOLDFAST_INLINE bool TakesTerms(const ConvolutionMaps& m) {
  return (m.kernel_height == 1 || m.kernel_height == 3) && m.kernel_width == 3 && m.stride == 1 &&
         m.channels >= kTermChannels;
}
// Of a part: lines of terms, and of results.
HOLDFAST_INLINE int64_t TermLines(const ConvolutionMaps& m) { return m.kernel_height == 3 ? kTerms : 1; }
HOLDFAST_INLINE int64_t PartLines(const ConvolutionMaps& m) { return TakesTerms(m) && m.kernel_height == 3 ? 2 : 1; }
// Of so many lines of a map's result.
HOLDFAST_INLINE int64_t PartsOf(const ConvolutionMaps& m, int64_t lines) {
  return (lines + PartLines(m) - 1) / PartLines(m);
}
HOLDFAST_INLINE int64_t Pairs(const ConvolutionMaps& m) { return (m.out_width + 1) / 2; }

// Floats of a row of the input with zeros around it, [2 pairs + 2, C]; of its terms, [kTerms, pairs, C]; and of those
// of a part, [term lines, kTerms, pairs, C].
HOLDFAST_INLINE int64_t LineFloats(const ConvolutionMaps& m) { return (2 * Pairs(m) + 2) * m.channels; }
HOLDFAST_INLINE int64_t TermFloats(const ConvolutionMaps& m) { return kTerms * Pairs(m) * m.channels; }
HOLDFAST_INLINE int64_t PartFloats(const ConvolutionMaps& m) { return TermLines(m) * TermFloats(m); }

// Each term is a convolution of single pixels, one a pair, into a panel of channels.
HOLDFAST_INLINE ConvolutionMaps TermOf(const ConvolutionMaps& m, int64_t panel) {
  ConvolutionMaps term = m;
  term.kernel_height = term.kernel_width = 1;
  term.width = term.out_width = Pairs(m);
  term.out_channels = panel;
  return term;
}

// From the weights g0, g1 and g2 at 0, 'step' and 3 'step' those of the terms, in place; of so many floats each.
template <int64_t kWidth>
HOLDFAST_INLINE void MixWeights(float* g, int64_t step, int64_t count) {
  for (int64_t i = 0; i < count; i += kWidth) {
    const Lanes<kWidth> ends = (Load<kWidth>(g + i) + Load<kWidth>(g + 3 * step + i)) * 0.5f;
    const Lanes<kWidth> middle = Load<kWidth>(g + step + i) * 0.5f;
    Store(ends + middle, g + step + i);
    Store(ends - middle, g + 2 * step + i);
  }
}

HOLDFAST_INLINE int64_t PanelTermFloats(const ConvolutionMaps& m, int64_t panel) {
  return TermLines(m) * kTerms * (m.channels + 1) * panel;
}

// The terms' weights of a panel, [term lines, kTerms], each as Pack has a panel's. All results have the second term (of
// the second line), so the bias is there.
template <int64_t kWidth>
HOLDFAST_INLINE void PackTerms(const ConvolutionMaps& m, int64_t first, int64_t used, int64_t panel, float* to) {
  constexpr int64_t kPlaces[] = {0, 1, 3};              // of the kernel's columns and lines among the terms
  const int64_t step = (m.channels + 1) * panel;        // from term to term
  const int64_t middle = m.kernel_height == 3 ? 1 : 0;  // line of terms
  std::fill_n(to, PanelTermFloats(m, panel), 0.0f);
  for (int64_t line = 0; line < m.kernel_height; ++line) {
    float* terms = to + kPlaces[line] * kTerms * step + panel;
    for (int64_t i = 0; i < 3; ++i) {
      const float* from = m.weights + first * Depth(m) + (line * 3 + i) * m.channels;
      Transpose(from, Depth(m), m.channels, used, terms + kPlaces[i] * step, panel);
    }
    MixWeights<kWidth>(terms, step, m.channels * panel);
  }
  if (m.kernel_height == 3) MixWeights<kWidth>(to, kTerms * step, kTerms * step);
  PackBias(m, first, used, to + (middle * kTerms + 1) * step);
}

template <typename V>
HOLDFAST_INLINE void Split(const V (&d)[kTerms], V (&m)[kTerms]) {
  m[0] = d[0] - d[2];
  m[1] = d[1] + d[2];
  m[2] = d[2] - d[1];
  m[3] = d[1] - d[3];
}

// 'out' gets the four terms of the 'count' floats at each of 'd', one 'step' floats behind the other.
template <int64_t kWidth>
HOLDFAST_INLINE void MakeTerms(const float* const (&d)[kTerms], int64_t count, int64_t step, float* out) {
  int64_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    Lanes<kWidth> terms[kTerms];
    Split({Load<kWidth>(d[0] + i), Load<kWidth>(d[1] + i), Load<kWidth>(d[2] + i), Load<kWidth>(d[3] + i)}, terms);
    for (int64_t k = 0; k < kTerms; ++k) Store(terms[k], out + k * step + i);
  }
  for (; i < count; ++i) {
    float terms[kTerms];
    Split({d[0][i], d[1][i], d[2][i], d[3][i]}, terms);
    for (int64_t k = 0; k < kTerms; ++k) out[k * step + i] = terms[k];
  }
}

// [2 pairs + 2, C] -> [kTerms, pairs, C]
template <int64_t kWidth>
HOLDFAST_INLINE void MakeTermsOfLine(const float* line, int64_t pairs, int64_t channels, float* out) {
  for (int64_t i = 0; i < pairs; ++i, line += 2 * channels, out += channels) {
    MakeTerms<kWidth>({line, line + channels, line + 2 * channels, line + 3 * channels}, channels, pairs * channels,
                      out);
  }
}

// The two results of four terms.
template <typename V>
HOLDFAST_INLINE void Join(const V (&m)[kTerms], V (&y)[2]) {
  y[0] = m[0] + (m[1] + m[2]);
  y[1] = (m[1] - m[2]) - m[3];
}

// A register's channels of one pair of pixels of kLines lines, from the terms' results, which follow one another by
// 'step'.
template <int64_t kWidth, int64_t kLines>
HOLDFAST_INLINE void JoinPair(const float* results, int64_t step, Lanes<kWidth> (&y)[kLines][2]) {
  using V = Lanes<kWidth>;
  V lines[kLines][kTerms];
  for (int64_t j = 0; j < kTerms; ++j) {
    if (kLines == 1) {
      lines[0][j] = Load<kWidth>(results + j * step);
      continue;
    }
    V m[kTerms], joined[2];
    for (int64_t i = 0; i < kTerms; ++i) m[i] = Load<kWidth>(results + (i * kTerms + j) * step);
    Join(m, joined);
    for (int64_t line = 0; line < kLines; ++line) lines[line][j] = joined[line];
  }
  for (int64_t line = 0; line < kLines; ++line) Join(lines[line], y[line]);
}

// The first 'count' values, or all.
template <typename V>
HOLDFAST_INLINE void StoreFirst(const V& value, int64_t count, float* to) {
  if (count >= kLanesOf<V>) return Store(value, to);
  for (int64_t i = 0; i < count; ++i) to[i] = value[i];
}

// Channels [first, first + kPanel) of 'lines' lines of the result, of all terms' results [terms, parts, pairs, kPanel].
template <int64_t kWidth, int64_t kVectors, int64_t kLines>
HOLDFAST_INLINE void JoinTerms(const ConvolutionMaps& m, const float* results, int64_t lines, int64_t first, float* y) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const int64_t step = PartsOf(m, lines) * Pairs(m) * kPanel;
  for (int64_t top = 0; top < lines; top += kLines) {
    for (int64_t x = 0; x < m.out_width; x += 2, results += kPanel) {
      for (int64_t c = 0; c < kPanel && first + c < m.out_channels; c += kWidth) {
        Lanes<kWidth> pixels[kLines][2];
        JoinPair<kWidth, kLines>(results + c, step, pixels);
        for (int64_t i = 0; i < 2 * kLines; ++i) {
          if (top + i / 2 >= lines || x + i % 2 >= m.out_width) continue;
          float* to = y + ((top + i / 2) * m.out_width + x + i % 2) * m.out_channels + first + c;
          StoreFirst(pixels[i / 2][i % 2], m.out_channels - first - c, to);
        }
      }
    }
  }
}

// 'lines' lines of the result, from the terms of their parts. 'results' has room for those of a panel.
template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunTerms(const ConvolutionMaps& m, const Rows& input, float* results, float* y, int64_t lines) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const ConvolutionMaps term = TermOf(m, kPanel);
  const int64_t parts = PartsOf(m, lines);
  const float* packed = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += kPanel) {
    for (int64_t i = 0; i < TermLines(m) * kTerms; ++i, packed += (m.channels + 1) * kPanel) {
      const Rows inputs = {input.first + i * Pairs(m) * m.channels, input.floats, input.sums};
      RunPanel<kWidth, kPixels, kVectors>({term, inputs, packed, 0, results + i * parts * Pairs(m) * kPanel}, parts);
    }
    if (PartLines(m) == 2) {
      JoinTerms<kWidth, kVectors, 2>(m, results, lines, first, y);
    } else {
      JoinTerms<kWidth, kVectors, 1>(m, results, lines, first, y);
    }
  }
}

}  // namespace holdfast::convolution
