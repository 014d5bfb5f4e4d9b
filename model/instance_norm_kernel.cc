// SPDX-License-Identifier: Apache-2.0
#include "model/instance_norm_kernel.h"

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

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

template <typename T>
HOLDFAST_INLINE void BlockMoments(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block block = BlockAt(i, m.pixels, m.channels);
    float* mean = m.partial + i * 2 * m.channels;
    Moments(m.x + block.first, block.pixels, m.channels, mean, mean + m.channels);
  }
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void ApplyRows(const T* __restrict x, const T* __restrict identity, const float* __restrict mean,
                               const float* __restrict rstd, T* __restrict y, const Fold& fold) {
  for (int64_t r = 0; r < fold.rows; ++r) {
    for (int64_t c = 0; c < fold.width; ++c) {
      const int64_t i = r * fold.width + c;
      float value = (ToFloat(x[i]) - mean[c]) * rstd[c];
      if (kTail != NormTail::kNone) value = value > 0 ? value : 0;
      if (kTail == NormTail::kReluAddRelu) {
        value += ToFloat(identity[i]);
        value = value > 0 ? value : 0;
      }
      Assign(value, y + i);
    }
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
HOLDFAST_INLINE void Apply(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block b = BlockAt(i, m.pixels, m.channels);
    const Fold fold = FoldOf(b.pixels, m.channels);
    WideMoments w;
    WidenMoments(m.moments + b.map * 2 * m.channels, fold, w);
    const T* x = m.x + b.first;
    T* y = m.y + b.first;
    if (m.tail == NormTail::kNone) ApplyRows<NormTail::kNone>(x, x, w.mean, w.rstd, y, fold);
    if (m.tail == NormTail::kRelu) ApplyRows<NormTail::kRelu>(x, x, w.mean, w.rstd, y, fold);
    if (m.tail == NormTail::kReluAddRelu) {
      ApplyRows<NormTail::kReluAddRelu>(x, m.identity + b.first, w.mean, w.rstd, y, fold);
    }
  }
}

// The gradient that reaches the norm's result, given the normed value.
template <NormTail kTail>
HOLDFAST_INLINE float Masked(float grad, float normed) {
  return kTail == NormTail::kNone || normed > 0 ? grad : 0.0f;
}

// What the sums of a block read and write: values of its pixels, and of the columns of a row.
template <typename T>
struct GradientColumns {
  const T* x;
  const T* y;
  const T* grad_y;
  T* grad_identity;
  const float* mean;
  const float* rstd;
  float* sum;
  float* products;
};

// kLanes columns at once; compilers leave the loop below scalar for its choices.
template <NormTail kTail, typename T>
HOLDFAST_INLINE void SumLanes(const GradientColumns<T>& at, int64_t i, int64_t c) {
  Lanes grad = Load(at.grad_y + i);
  if (kTail == NormTail::kReluAddRelu) {
    grad = Load(at.y + i) > 0 ? grad : Lanes{};
    StoreExact(grad, at.grad_identity + i);
  }
  const Lanes normed = (Load(at.x + i) - Load(at.mean + c)) * Load(at.rstd + c);
  if (kTail != NormTail::kNone) grad = normed > 0 ? grad : Lanes{};
  Store(Load(at.sum + c) + grad, at.sum + c);
  Store(Load(at.products + c) + grad * normed, at.products + c);
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void SumColumn(const GradientColumns<T>& at, int64_t i, int64_t c) {
  float grad = ToFloat(at.grad_y[i]);
  if (kTail == NormTail::kReluAddRelu) {
    grad = ToFloat(at.y[i]) > 0 ? grad : 0.0f;
    Assign(grad, at.grad_identity + i);
  }
  const float normed = (ToFloat(at.x[i]) - at.mean[c]) * at.rstd[c];
  grad = Masked<kTail>(grad, normed);
  at.sum[c] += grad;
  at.products[c] += grad * normed;
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void SumGradients(const NormMaps<T>& m, const Block& b, const Fold& fold, float* sum,
                                  float* products) {
  WideMoments w;
  WidenMoments(m.moments + b.map * 2 * m.channels, fold, w);
  T* grad_identity = kTail == NormTail::kReluAddRelu ? m.grad_identity + b.first : nullptr;
  const GradientColumns<T> at = {m.x + b.first, m.y + b.first, m.grad_y + b.first, grad_identity, w.mean, w.rstd, sum,
                                 products};
  std::fill_n(sum, fold.width, 0.0f);
  std::fill_n(products, fold.width, 0.0f);
  for (int64_t r = 0; r < fold.rows; ++r) {
    int64_t c = 0;
    for (; c + kLanes <= fold.width; c += kLanes) SumLanes<kTail>(at, r * fold.width + c, c);
    for (; c < fold.width; ++c) SumColumn<kTail>(at, r * fold.width + c, c);
  }
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void GradientsOfBlock(const NormMaps<T>& m, const Block& b, float* sum, float* products) {
  const Fold fold = FoldOf(b.pixels, m.channels);
  if (fold.fold == 1) return SumGradients<kTail>(m, b, fold, sum, products);
  float wide_sum[kMaxWidth] = {};
  float wide_products[kMaxWidth] = {};
  SumGradients<kTail>(m, b, fold, wide_sum, wide_products);
  Narrow(fold, wide_sum, sum);
  Narrow(fold, wide_products, products);
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void ApplyGradientsToBlock(const NormMaps<T>& m, const Block& b) {
  const Fold fold = FoldOf(b.pixels, m.channels);
  WideMoments w;
  WidenMoments(m.moments + b.map * 2 * m.channels, fold, w);
  float sum_buffer[kMaxWidth];
  float products_buffer[kMaxWidth];
  const float* sums = m.sums + b.map * 2 * m.channels;
  const float* __restrict mean = w.mean;
  const float* __restrict rstd = w.rstd;
  const float* __restrict sum = Widen(fold, sums, sum_buffer);
  const float* __restrict products = Widen(fold, sums + m.channels, products_buffer);
  const T* __restrict x = m.x + b.first;
  // grad_identity holds the gradient behind the outer ReLU.
  const T* __restrict grad_y = (kTail == NormTail::kReluAddRelu ? m.grad_identity : m.grad_y) + b.first;
  T* __restrict grad_x = m.grad_x + b.first;
  for (int64_t r = 0; r < fold.rows; ++r) {
    for (int64_t c = 0; c < fold.width; ++c) {
      const int64_t i = r * fold.width + c;
      const float normed = (ToFloat(x[i]) - mean[c]) * rstd[c];
      const float grad = Masked<kTail>(ToFloat(grad_y[i]), normed);
      Assign(rstd[c] * (grad - sum[c] - normed * products[c]), grad_x + i);
    }
  }
}

template <typename T>
HOLDFAST_INLINE void BlockGradients(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block block = BlockAt(i, m.pixels, m.channels);
    float* sum = m.partial + i * 2 * m.channels;
    float* products = sum + m.channels;
    if (m.tail == NormTail::kNone) GradientsOfBlock<NormTail::kNone>(m, block, sum, products);
    if (m.tail == NormTail::kRelu) GradientsOfBlock<NormTail::kRelu>(m, block, sum, products);
    if (m.tail == NormTail::kReluAddRelu) GradientsOfBlock<NormTail::kReluAddRelu>(m, block, sum, products);
  }
}

template <typename T>
HOLDFAST_INLINE void ApplyGradients(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block block = BlockAt(i, m.pixels, m.channels);
    if (m.tail == NormTail::kNone) ApplyGradientsToBlock<NormTail::kNone>(m, block);
    if (m.tail == NormTail::kRelu) ApplyGradientsToBlock<NormTail::kRelu>(m, block);
    if (m.tail == NormTail::kReluAddRelu) ApplyGradientsToBlock<NormTail::kReluAddRelu>(m, block);
  }
}

}  // namespace

HOLDFAST_SIMD void NormBlockMoments(const NormMaps<float>& maps, int64_t begin, int64_t end) {
  BlockMoments(maps, begin, end);
}
HOLDFAST_SIMD void NormBlockMoments(const NormMaps<Bf16>& maps, int64_t begin, int64_t end) {
  BlockMoments(maps, begin, end);
}
HOLDFAST_SIMD void NormApply(const NormMaps<float>& maps, int64_t begin, int64_t end) { Apply(maps, begin, end); }
HOLDFAST_SIMD void NormApply(const NormMaps<Bf16>& maps, int64_t begin, int64_t end) { Apply(maps, begin, end); }
HOLDFAST_SIMD void NormBlockGradients(const NormMaps<float>& maps, int64_t begin, int64_t end) {
  BlockGradients(maps, begin, end);
}
HOLDFAST_SIMD void NormBlockGradients(const NormMaps<Bf16>& maps, int64_t begin, int64_t end) {
  BlockGradients(maps, begin, end);
}
HOLDFAST_SIMD void NormApplyGradients(const NormMaps<float>& maps, int64_t begin, int64_t end) {
  ApplyGradients(maps, begin, end);
}
HOLDFAST_SIMD void NormApplyGradients(const NormMaps<Bf16>& maps, int64_t begin, int64_t end) {
  ApplyGradients(maps, begin, end);
}

// Joins means and sums of squares pairwise (Chan et al.): exact where sums of squares would cancel.
void NormJoinMoments(const float* partial, int64_t pixels, int64_t channels, float* moments) {
  const int64_t blocks = NormBlocks(pixels);
  for (int64_t c = 0; c < channels; ++c) {
    double mean = 0;
    double squares = 0;
    double count = 0;
    for (int64_t b = 0; b < blocks; ++b) {
      const double size = static_cast<double>(std::min(kNormBlock, pixels - b * kNormBlock));
      const double delta = partial[b * 2 * channels + c] - mean;
      const double total = count + size;
      mean += delta * size / total;
      squares += partial[(b * 2 + 1) * channels + c] + delta * delta * count * size / total;
      count = total;
    }
    moments[c] = static_cast<float>(mean);
    moments[channels + c] = static_cast<float>(1.0 / std::sqrt(squares / count + kNormEpsilon));
  }
}

void NormJoinGradients(const float* partial, int64_t pixels, int64_t channels, float* sums) {
  const int64_t blocks = NormBlocks(pixels);
  for (int64_t c = 0; c < 2 * channels; ++c) {
    double sum = 0;
    for (int64_t b = 0; b < blocks; ++b) sum += partial[b * 2 * channels + c];
    sums[c] = static_cast<float>(sum / static_cast<double>(pixels));
  }
}

}  // namespace holdfast
