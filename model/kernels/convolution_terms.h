// SPDX-License-Identifier: Apache-2.0
// Winograd's F(2, 3) for convolution.cc (Winograd 1980; Lavin and Gray 2016): two neighbours in a row, which kernels
// three pixels wide make of four pixels d by six products a channel, are made of four, the terms:
//   m0 = (d0 - d2) g0, m1 = (d1 + d2) (g0 + g1 + g2) / 2, m2 = (d2 - d1) (g0 - g1 + g2) / 2, m3 = (d1 - d3) g2
//   y0 = m0 + m1 + m2, y1 = m1 - m2 - m3
// Terms of the lines of a kernel and of the channels are added up before results are made of them. Included by kernels
// alone.
#pragma once

#include <algorithm>
#include <cstdint>

#include "model/kernels/convolution_panels.h"

namespace holdfast::convolution {

constexpr int64_t kTerms = 4;
constexpr int64_t kTermChannels = 32;  // with fewer, making terms costs what they save

HOLDFAST_INLINE bool TakesTerms(const ConvolutionMaps& m) {
  return m.kernel_width == 3 && m.stride == 1 && m.channels >= kTermChannels;
}
HOLDFAST_INLINE int64_t Pairs(const ConvolutionMaps& m) { return (m.out_width + 1) / 2; }

// Each term is a convolution with kernels one pixel wide, of maps of one pixel a pair, into a panel of channels.
HOLDFAST_INLINE ConvolutionMaps TermOf(const ConvolutionMaps& m, int64_t panel) {
  ConvolutionMaps term = m;
  term.kernel_width = 1;
  term.width = term.out_width = Pairs(m);
  term.out_channels = panel;
  return term;
}

// Floats of a row of the input with zeros around it, [2 pairs + 2, C], and of its terms, [kTerms, pairs, C].
HOLDFAST_INLINE int64_t LineFloats(const ConvolutionMaps& m) { return (2 * Pairs(m) + 2) * m.channels; }
HOLDFAST_INLINE int64_t TermFloats(const ConvolutionMaps& m) { return kTerms * Pairs(m) * m.channels; }

HOLDFAST_INLINE void PackBias(const ConvolutionMaps& m, int64_t first, int64_t used, float* to) {
  for (int64_t o = 0; o < used; ++o) to[o] = m.bias == nullptr ? 0.0f : m.bias[first + o];
}

// The four terms' weights of a panel, each as Pack has a panel's: columns of the kernel, then mixtures of them. Both
// results have the second term, so the bias is there.
template <int64_t kWidth>
HOLDFAST_INLINE void PackTerms(const ConvolutionMaps& m, int64_t first, int64_t used, int64_t panel, float* to) {
  const int64_t inputs = m.kernel_height * m.channels;  // of a term
  const int64_t step = (inputs + 1) * panel;            // from term to term
  std::fill_n(to, kTerms * step, 0.0f);
  PackBias(m, first, used, to + step);
  float* const columns[] = {to + panel, to + step + panel, to + 3 * step + panel};
  for (int64_t line = 0; line < m.kernel_height; ++line) {
    for (int64_t i = 0; i < 3; ++i) {
      const float* from = m.weights + first * Depth(m) + (line * 3 + i) * m.channels;
      Transpose(from, Depth(m), m.channels, used, columns[i] + line * m.channels * panel, panel);
    }
  }
  float* third = to + 2 * step + panel;
  for (int64_t i = 0; i < inputs * panel; i += kWidth) {
    const Lanes<kWidth> ends = (Load<kWidth>(columns[0] + i) + Load<kWidth>(columns[2] + i)) * 0.5f;
    const Lanes<kWidth> middle = Load<kWidth>(columns[1] + i) * 0.5f;
    Store(ends + middle, columns[1] + i);
    Store(ends - middle, third + i);
  }
}

// [2 pairs + 2, C] -> [kTerms, pairs, C]
template <int64_t kWidth>
HOLDFAST_INLINE void MakeTerms(const float* line, int64_t pairs, int64_t channels, float* out) {
  using V = Lanes<kWidth>;
  const int64_t step = pairs * channels;
  for (int64_t i = 0; i < pairs; ++i, line += 2 * channels, out += channels) {
    int64_t c = 0;
    for (; c + kWidth <= channels; c += kWidth) {
      const V d[] = {Load<kWidth>(line + c), Load<kWidth>(line + channels + c), Load<kWidth>(line + 2 * channels + c),
                     Load<kWidth>(line + 3 * channels + c)};
      Store(d[0] - d[2], out + c);
      Store(d[1] + d[2], out + step + c);
      Store(d[2] - d[1], out + 2 * step + c);
      Store(d[1] - d[3], out + 3 * step + c);
    }
    for (; c < channels; ++c) {
      const float d[] = {line[c], line[channels + c], line[2 * channels + c], line[3 * channels + c]};
      out[c] = d[0] - d[2];
      out[step + c] = d[1] + d[2];
      out[2 * step + c] = d[2] - d[1];
      out[3 * step + c] = d[1] - d[3];
    }
  }
}

// Channels [first, first + kPanel) of rows of the result, of all terms' results.
template <int64_t kWidth, int64_t kVectors>
HOLDFAST_INLINE void JoinTerms(const ConvolutionMaps& m, const float* results, int64_t rows, int64_t first, float* y) {
  using V = Lanes<kWidth>;
  constexpr int64_t kPanel = kVectors * kWidth;
  const int64_t step = rows * Pairs(m) * kPanel;
  const int64_t channels = std::min(kPanel, m.out_channels - first);
  for (int64_t row = 0; row < rows; ++row) {
    for (int64_t x = 0; x < m.out_width; x += 2, results += kPanel) {
      float joined[2][kPanel];
      for (int64_t c = 0; c < kPanel; c += kWidth) {
        const V m1 = Load<kWidth>(results + step + c), m2 = Load<kWidth>(results + 2 * step + c);
        Store(Load<kWidth>(results + c) + (m1 + m2), joined[0] + c);
        Store((m1 - m2) - Load<kWidth>(results + 3 * step + c), joined[1] + c);
      }
      for (int64_t i = 0; i < std::min<int64_t>(2, m.out_width - x); ++i) {
        float* to = y + (row * m.out_width + x + i) * m.out_channels + first;
        if (channels == kPanel) {
          std::copy_n(joined[i], kPanel, to);  // a number known to the compiler
        } else {
          std::copy_n(joined[i], channels, to);
        }
      }
    }
  }
}

template <int64_t kWidth, int64_t kPixels, int64_t kVectors>
HOLDFAST_INLINE void RunTerms(const ConvolutionMaps& m, const Rows& input, float* results, float* y, int64_t rows) {
  constexpr int64_t kPanel = kVectors * kWidth;
  const ConvolutionMaps term = TermOf(m, kPanel);
  const float* packed = m.packed;
  for (int64_t first = 0; first < m.out_channels; first += kPanel) {
    for (int64_t i = 0; i < kTerms; ++i, packed += (Depth(term) + 1) * kPanel) {
      const Rows inputs = {input.first + i * Pairs(m) * m.channels, input.floats, input.sums};
      float* of_term = results + i * rows * Pairs(m) * kPanel;
      RunPanel<kWidth, kPixels, kVectors>({term, inputs, packed, 0, of_term}, rows);
    }
    JoinTerms<kWidth, kVectors>(m, results, rows, first, y);
  }
}

}  // namespace holdfast::convolution
