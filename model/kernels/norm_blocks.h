// SPDX-License-Identifier: Apache-2.0
// What kernels that take a norm's moments share: blocks of pixels, how their rows are cut, and the moments of a block.
#pragma once

#include <algorithm>

#include "model/kernels/instance_norm.h"

namespace holdfast {

// A block of pixels of one map.
struct Block {
  int64_t map;
  int64_t first;  // offset of its first value within all maps
  int64_t pixels;
};

HOLDFAST_INLINE Block BlockAt(int64_t item, int64_t pixels, int64_t channels) {
  const int64_t blocks = NormBlocks(pixels);
  const int64_t map = item / blocks;
  const int64_t begin = (item % blocks) * kNormBlock;
  return {map, (map * pixels + begin) * channels, std::min(kNormBlock, pixels - begin)};
}

// With few channels several pixels are taken as one wide one, so that the vector units have enough to do: 'pixels'
// pixels of 'channels' become rows * width values, a row holding 'fold' pixels.
constexpr int64_t kMaxWidth = 256;

struct Fold {
  int64_t channels;
  int64_t fold;
  int64_t rows;
  int64_t width;
};

HOLDFAST_INLINE Fold FoldOf(int64_t pixels, int64_t channels) {
  int64_t fold = 1;
  while (2 * fold * channels <= kMaxWidth && pixels % (2 * fold) == 0) fold *= 2;
  return {channels, fold, pixels / fold, channels * fold};
}

// Values of the channels, repeated for each pixel of a row; in 'buffer' where that takes copies.
HOLDFAST_INLINE const float* Widen(const Fold& fold, const float* values, float* buffer) {
  if (fold.fold == 1) return values;
  for (int64_t i = 0; i < fold.width; i += fold.channels) std::copy_n(values, fold.channels, buffer + i);
  return buffer;
}

// Sums of the columns of a row -> sums of the channels.
HOLDFAST_INLINE void Narrow(const Fold& fold, const float* wide, float* sums) {
  std::copy_n(wide, fold.channels, sums);
  for (int64_t i = fold.channels; i < fold.width; i += fold.channels) {
    for (int64_t c = 0; c < fold.channels; ++c) sums[c] += wide[i + c];
  }
}

// Mean and 1 / deviation of a map, widened for a block's rows.
struct WideMoments {
  float mean_buffer[kMaxWidth];
  float rstd_buffer[kMaxWidth];
  const float* mean;
  const float* rstd;
};

HOLDFAST_INLINE void WidenMoments(const float* moments, const Fold& fold, WideMoments& wide) {
  wide.mean = Widen(fold, moments, wide.mean_buffer);
  wide.rstd = Widen(fold, moments + fold.channels, wide.rstd_buffer);
}

template <typename T>
HOLDFAST_INLINE void SumRows(const T* __restrict x, const Fold& fold, float* __restrict sums) {
  std::fill_n(sums, fold.width, 0.0f);
  for (int64_t r = 0; r < fold.rows; ++r) {
    for (int64_t i = 0; i < fold.width; ++i) sums[i] += ToFloat(x[r * fold.width + i]);
  }
}

template <typename T>
HOLDFAST_INLINE void SumSquares(const T* __restrict x, const Fold& fold, const float* __restrict mean,
                                float* __restrict sums) {
  std::fill_n(sums, fold.width, 0.0f);
  for (int64_t r = 0; r < fold.rows; ++r) {
    for (int64_t i = 0; i < fold.width; ++i) {
      const float d = ToFloat(x[r * fold.width + i]) - mean[i];
      sums[i] += d * d;
    }
  }
}

// Mean and sum of squared distances from it, of each channel.
template <typename T>
HOLDFAST_INLINE void Moments(const T* x, int64_t pixels, int64_t channels, float* mean, float* squares) {
  const Fold fold = FoldOf(pixels, channels);
  float wide_sums[kMaxWidth] = {};
  float wide_mean[kMaxWidth];
  float* sums = fold.fold == 1 ? mean : wide_sums;
  SumRows(x, fold, sums);
  if (fold.fold > 1) Narrow(fold, sums, mean);
  const float scale = 1.0f / static_cast<float>(pixels);
  for (int64_t c = 0; c < channels; ++c) mean[c] *= scale;
  sums = fold.fold == 1 ? squares : wide_sums;
  SumSquares(x, fold, Widen(fold, mean, wide_mean), sums);
  if (fold.fold > 1) Narrow(fold, sums, squares);
}

}  // namespace holdfast
