// SPDX-License-Identifier: Apache-2.0
// Winograd's minimal filters for convolution.cc (Winograd 1980; Lavin and Gray 2016). Kernels three pixels wide make
// four neighbours of six pixels d by twelve products a channel. F(4, 3) makes them of six, the terms: d and the weights
// g are taken for polynomials, whose product is known from its values at 0, a, -a, b, -b and infinity:
//   m0 = (a²b² d0 - (a² + b²) d2 + d4) g0 / a²b²         m5 = (a²b² d1 - (a² + b²) d3 + d5) g2
//   m1, m2 = ((d4 - b² d2) ± a (d3 - b² d1)) (g0 ± a g1 + a² g2) / (2a² (a² - b²)), m3 and m4 with a and b swapped
//   y0 = m0 + m1 + m2 + m3 + m4           y1 = a (m1 - m2) + b (m3 - m4)
//   y2 = a² (m1 + m2) + b² (m3 + m4)      y3 = a³ (m1 - m2) + b³ (m3 - m4) + m5
// With a = 3/4 and b = 3/2 sums are rounded half as much as with the customary 1 and 2, 2.5 times as much as without
// terms. Kernels of three lines with channels enough take terms of those terms, of four lines by F(2, 3), which is the
// same at 0, 1, -1 and infinity: a pair of lines and four columns cost 24 products, not 72. A part of the result is a
// line, or such a pair. Included by kernels alone.
#pragma once

#include <algorithm>
#include <cstdint>

#include "model/kernels/convolution_panels.h"

namespace holdfast::convolution {

constexpr int64_t kTerms = 6;
constexpr int64_t kQuad = 4;       // results of so many terms
constexpr int64_t kLineTerms = 4;  // of lines
// With fewer channels making terms, or those of lines, costs what they save.
constexpr int64_t kTermChannels = 16;
constexpr int64_t kLineTermChannels = 32;

constexpr float kA = 0.75f, kA2 = kA * kA, kA3 = kA2 * kA;
constexpr float kB = 1.5f, kB2 = kB * kB, kB3 = kB2 * kB;

HOLDFAST_INLINE bool TakesTerms(const ConvolutionMaps& m) {
  return (m.kernel_height == 1 || m.kernel_height == 3) && m.kernel_width == 3 && m.stride == 1 &&
         m.channels >= kTermChannels;
}
HOLDFAST_INLINE bool TakesTermsOfLines(const ConvolutionMaps& m) {
  return TakesTerms(m) && m.kernel_height == 3 && m.channels >= kLineTermChannels;
}
// All terms of a part, and the lines of the kernel that each of them is still to be convolved with.
HOLDFAST_INLINE int64_t PartTerms(const ConvolutionMaps& m) {
  return TakesTermsOfLines(m) ? kLineTerms * kTerms : kTerms;
}
HOLDFAST_INLINE int64_t TermHeight(const ConvolutionMaps& m) { return TakesTermsOfLines(m) ? 1 : m.kernel_height; }
HOLDFAST_INLINE int64_t PartLines(const ConvolutionMaps& m) { return TakesTermsOfLines(m) ? 2 : 1; }
// Of so many lines of a map's result.
HOLDFAST_INLINE int64_t PartsOf(const ConvolutionMaps& m, int64_t lines) {
  return (lines + PartLines(m) - 1) / PartLines(m);
}
HOLDFAST_INLINE int64_t Quads(const ConvolutionMaps& m) { return (m.out_width + kQuad - 1) / kQuad; }

// Floats of a row of the input with zeros around it, [4 quads + 2, C]; of one of its terms, [quads, C]; and of a term
// of a group of parts, [parts and what the kernel reaches beyond them, quads, C].
HOLDFAST_INLINE int64_t LineFloats(const ConvolutionMaps& m) { return (kQuad * Quads(m) + 2) * m.channels; }
HOLDFAST_INLINE int64_t TermFloats(const ConvolutionMaps& m) { return Quads(m) * m.channels; }
HOLDFAST_INLINE int64_t GroupTermFloats(const ConvolutionMaps& m, int64_t parts) {
  return (parts + TermHeight(m) - 1) * TermFloats(m);
}

// Each term is a convolution of single columns into a panel of channels. Lines follow one another without a gap, so
// that those of a group are one line.
HOLDFAST_INLINE ConvolutionMaps TermOf(const ConvolutionMaps& m, int64_t parts, int64_t panel) {
  ConvolutionMaps term = m;
  term.kernel_height = TermHeight(m);
  term.kernel_width = 1;
  term.width = term.out_width = parts * Quads(m);
  term.out_channels = panel;
  return term;
}

// Floats of a term's weights as Pack has a panel's, with zeros for the bias; and of a panel's: its bias, then the
// terms'.
HOLDFAST_INLINE int64_t TermWeightFloats(const ConvolutionMaps& m, int64_t panel) {
  return (TermHeight(m) * m.channels + 1) * panel;
}
HOLDFAST_INLINE int64_t PanelTermFloats(const ConvolutionMaps& m, int64_t panel) {
  return panel + PartTerms(m) * TermWeightFloats(m, panel);
}

// From the weights g0, g1 and g2 at 0, 'step' and 5 'step' those of the terms, in place; of so many floats each.
template <int64_t kWidth>
HOLDFAST_INLINE void MixWeights(float* g, int64_t step, int64_t count) {
  constexpr float kOfA = 1 / (2 * kA2 * (kA2 - kB2)), kOfB = 1 / (2 * kB2 * (kB2 - kA2));
  for (int64_t i = 0; i < count; i += kWidth, g += kWidth) {
    const Lanes<kWidth> g0 = Load<kWidth>(g), g1 = Load<kWidth>(g + step), g2 = Load<kWidth>(g + 5 * step);
    const Lanes<kWidth> a = (g0 + g2 * kA2) * kOfA, b = (g0 + g2 * kB2) * kOfB;
    Store(g0 * (1 / (kA2 * kB2)), g);
    Store(a + g1 * (kA * kOfA), g + step);
    Store(a - g1 * (kA * kOfA), g + 2 * step);
    Store(b + g1 * (kB * kOfB), g + 3 * step);
    Store(b - g1 * (kB * kOfB), g + 4 * step);
  }
}

// The same of lines, whose weights are at 0, 'step' and 3 'step'.
template <int64_t kWidth>
HOLDFAST_INLINE void MixWeightsOfLines(float* g, int64_t step, int64_t count) {
  for (int64_t i = 0; i < count; i += kWidth, g += kWidth) {
    const Lanes<kWidth> ends = (Load<kWidth>(g) + Load<kWidth>(g + 3 * step)) * 0.5f;
    const Lanes<kWidth> middle = Load<kWidth>(g + step) * 0.5f;
    Store(ends + middle, g + step);
    Store(ends - middle, g + 2 * step);
  }
}

// The weights of a panel: its bias, then [line terms, kTerms] or [kTerms] times those of a term.
template <int64_t kWidth>
HOLDFAST_INLINE void PackTerms(const ConvolutionMaps& m, int64_t first, int64_t used, int64_t panel, float* to) {
  constexpr int64_t kPlaces[] = {0, 1, 5},
                    kLinePlaces[] = {0, 1, 3};  // of the kernel's columns and lines among the terms
  const int64_t step = TermWeightFloats(m, panel), values = m.channels * panel;
  float* terms = to + panel;
  std::fill_n(to, PanelTermFloats(m, panel), 0.0f);
  PackBias(m, first, used, to);
  for (int64_t line = 0; line < m.kernel_height; ++line) {
    float* of_line = terms + panel + (TakesTermsOfLines(m) ? kLinePlaces[line] * kTerms * step : line * values);
    for (int64_t i = 0; i < 3; ++i) {
      const float* from = m.weights + first * Depth(m) + (line * 3 + i) * m.channels;
      Transpose(from, Depth(m), m.channels, used, of_line + kPlaces[i] * step, panel);
    }
    MixWeights<kWidth>(of_line, step, values);
  }
  if (TakesTermsOfLines(m)) MixWeightsOfLines<kWidth>(terms, kTerms * step, kTerms * step);
}

template <typename V>
HOLDFAST_INLINE void Split(const V (&d)[kTerms], V (&m)[kTerms]) {
  const V even_a = d[4] - d[2] * kB2, odd_a = (d[3] - d[1] * kB2) * kA;
  const V even_b = d[4] - d[2] * kA2, odd_b = (d[3] - d[1] * kA2) * kB;
  m[0] = d[0] * (kA2 * kB2) + (d[4] - d[2] * (kA2 + kB2));
  m[1] = even_a + odd_a;
  m[2] = even_a - odd_a;
  m[3] = even_b + odd_b;
  m[4] = even_b - odd_b;
  m[5] = d[1] * (kA2 * kB2) + (d[5] - d[3] * (kA2 + kB2));
}

template <typename V>
HOLDFAST_INLINE void Split(const V (&d)[kLineTerms], V (&m)[kLineTerms]) {
  m[0] = d[0] - d[2];
  m[1] = d[1] + d[2];
  m[2] = d[2] - d[1];
  m[3] = d[1] - d[3];
}

// 'out' gets the terms of the 'count' floats at each of 'd', one 'step' floats behind the other.
template <int64_t kWidth, int64_t kCount>
HOLDFAST_INLINE void MakeTerms(const float* const (&d)[kCount], int64_t count, int64_t step, float* out) {
  int64_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    Lanes<kWidth> in[kCount], terms[kCount];
    for (int64_t k = 0; k < kCount; ++k) in[k] = Load<kWidth>(d[k] + i);
    Split(in, terms);
    for (int64_t k = 0; k < kCount; ++k) Store(terms[k], out + k * step + i);
  }
  for (; i < count; ++i) {
    float in[kCount], terms[kCount];
    for (int64_t k = 0; k < kCount; ++k) in[k] = d[k][i];
    Split(in, terms);
    for (int64_t k = 0; k < kCount; ++k) out[k * step + i] = terms[k];
  }
}

// [4 quads + 2, C] -> kTerms times [quads, C], one 'step' floats behind the other.
template <int64_t kWidth>
HOLDFAST_INLINE void MakeTermsOfLine(const float* line, int64_t quads, int64_t channels, int64_t step, float* out) {
  for (int64_t i = 0; i < quads; ++i, line += kQuad * channels, out += channels) {
    const float* pixels[kTerms];
    for (int64_t k = 0; k < kTerms; ++k) pixels[k] = line + k * channels;
    MakeTerms<kWidth>(pixels, channels, step, out);
  }
}

// The results of so many terms.
template <typename V>
HOLDFAST_INLINE void Join(const V (&m)[kTerms], V (&y)[kQuad]) {
  const V sum_a = m[1] + m[2], sum_b = m[3] + m[4], difference_a = m[1] - m[2], difference_b = m[3] - m[4];
  y[0] = m[0] + (sum_a + sum_b);
  y[1] = difference_a * kA + difference_b * kB;
  y[2] = sum_a * kA2 + sum_b * kB2;
  y[3] = m[5] + (difference_a * kA3 + difference_b * kB3);
}

template <typename V>
HOLDFAST_INLINE void Join(const V (&m)[kLineTerms], V (&y)[2]) {
  y[0] = m[0] + (m[1] + m[2]);
  y[1] = (m[1] - m[2]) - m[3];
}

// A register's channels of a quad of each of kLines lines, from the terms' results, which follow one another by 'step'.
template <int64_t kWidth, int64_t kLines>
HOLDFAST_INLINE void JoinQuad(const float* results, int64_t step, Lanes<kWidth> (&y)[kLines][kQuad]) {
  Lanes<kWidth> lines[kLines][kTerms];
  for (int64_t j = 0; j < kTerms; ++j) {
    if constexpr (kLines == 1) {
      lines[0][j] = Load<kWidth>(results + j * step);
    } else {
      Lanes<kWidth> m[kLineTerms], joined[kLines];
      for (int64_t i = 0; i < kLineTerms; ++i) m[i] = Load<kWidth>(results + (i * kTerms + j) * step);
      Join(m, joined);
      for (int64_t line = 0; line < kLines; ++line) lines[line][j] = joined[line];
    }
  }
  for (int64_t line = 0; line < kLines; ++line) Join(lines[line], y[line]);
}

// The first 'count' values, or all.
template <typename V>
HOLDFAST_INLINE void StoreFirst(const V& value, int64_t count, float* to) {
  if (count >= kLanesOf<V>) return Store(value, to);
  for (int64_t i = 0; i < count; ++i) to[i] = value[i];
}

// Channels [first, first + kPanel) of 'lines' lines of the result, of all terms' results [terms, parts, quads, kPanel].
template <int64_t kWidth, int64_t kVectors, int64_t kLines>
HOLDFAST_INLINE void JoinTerms(const ConvolutionMaps& m, const float* bias, const float* results, int64_t lines,
                               int64_t first, float* y) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const int64_t step = PartsOf(m, lines) * Quads(m) * kPanel;
  for (int64_t top = 0; top < lines; top += kLines) {
    for (int64_t x = 0; x < m.out_width; x += kQuad, results += kPanel) {
      for (int64_t c = 0; c < kPanel && first + c < m.out_channels; c += kWidth) {
        Lanes<kWidth> pixels[kLines][kQuad];
        JoinQuad<kWidth, kLines>(results + c, step, pixels);
        for (int64_t i = 0; i < kLines * kQuad; ++i) {
          if (top + i / kQuad >= lines || x + i % kQuad >= m.out_width) continue;
          float* to = y + ((top + i / kQuad) * m.out_width + x + i % kQuad) * m.out_channels + first + c;
          StoreFirst(pixels[i / kQuad][i % kQuad] + Load<kWidth>(bias + c), m.out_channels - first - c, to);
        }
      }
    }
  }
}

// 'lines' lines of the result, from the terms of their parts; terms follow one another by 'step'. 'results' has room
// for those of a panel.
template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunTerms(const ConvolutionMaps& m, const Rows& input, int64_t step, float* results, float* y,
                              int64_t lines) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const ConvolutionMaps term = TermOf(m, PartsOf(m, lines), kPanel);
  const float* packed = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += kPanel) {
    const float* bias = packed;
    packed += kPanel;
    for (int64_t i = 0; i < PartTerms(m); ++i, packed += TermWeightFloats(m, kPanel)) {
      const Rows inputs = {input.first + i * step, TermFloats(m), input.sums};
      RunPanel<kWidth, kPixels, kVectors>({term, inputs, packed, 0, results + i * term.out_width * kPanel}, 1);
    }
    if (TakesTermsOfLines(m)) {
      JoinTerms<kWidth, kVectors, 2>(m, bias, results, lines, first, y);
    } else {
      JoinTerms<kWidth, kVectors, 1>(m, bias, results, lines, first, y);
    }
  }
}

}  // namespace holdfast::convolution
