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

template <typename T>
HOLDFAST_INLINE void Moments(const T* __restrict x, int64_t pixels, int64_t channels, float* __restrict mean,
                             float* __restrict squares) {
  std::fill_n(mean, channels, 0.0f);
  for (int64_t p = 0; p < pixels; ++p) {
    for (int64_t c = 0; c < channels; ++c) mean[c] += ToFloat(x[p * channels + c]);
  }
  const float scale = 1.0f / static_cast<float>(pixels);
  for (int64_t c = 0; c < channels; ++c) mean[c] *= scale;
  std::fill_n(squares, channels, 0.0f);
  for (int64_t p = 0; p < pixels; ++p) {
    for (int64_t c = 0; c < channels; ++c) {
      const float d = ToFloat(x[p * channels + c]) - mean[c];
      squares[c] += d * d;
    }
  }
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
HOLDFAST_INLINE void ApplyBlock(const T* __restrict x, const T* __restrict identity, const float* __restrict mean,
                                const float* __restrict rstd, T* __restrict y, int64_t pixels, int64_t channels) {
  for (int64_t p = 0; p < pixels; ++p) {
    for (int64_t c = 0; c < channels; ++c) {
      const int64_t i = p * channels + c;
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

template <typename T>
HOLDFAST_INLINE void Apply(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block b = BlockAt(i, m.pixels, m.channels);
    const float* mean = m.moments + b.map * 2 * m.channels;
    const float* rstd = mean + m.channels;
    const T* x = m.x + b.first;
    T* y = m.y + b.first;
    switch (m.tail) {
      case NormTail::kNone:
        ApplyBlock<NormTail::kNone>(x, x, mean, rstd, y, b.pixels, m.channels);
        break;
      case NormTail::kRelu:
        ApplyBlock<NormTail::kRelu>(x, x, mean, rstd, y, b.pixels, m.channels);
        break;
      case NormTail::kReluAddRelu:
        ApplyBlock<NormTail::kReluAddRelu>(x, m.identity + b.first, mean, rstd, y, b.pixels, m.channels);
        break;
    }
  }
}

// The gradient that reaches the norm's result, given the normed value.
template <NormTail kTail>
HOLDFAST_INLINE float Masked(float grad, float normed) {
  return kTail == NormTail::kNone || normed > 0 ? grad : 0.0f;
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void GradientsOfBlock(const NormMaps<T>& m, const Block& b, float* __restrict sum,
                                      float* __restrict products) {
  const int64_t channels = m.channels;
  const float* __restrict mean = m.moments + b.map * 2 * channels;
  const float* __restrict rstd = mean + channels;
  const T* __restrict x = m.x + b.first;
  const T* __restrict y = m.y + b.first;
  const T* __restrict grad_y = m.grad_y + b.first;
  std::fill_n(sum, 2 * channels, 0.0f);
  for (int64_t p = 0; p < b.pixels; ++p) {
    for (int64_t c = 0; c < channels; ++c) {
      const int64_t i = p * channels + c;
      float grad = ToFloat(grad_y[i]);
      if (kTail == NormTail::kReluAddRelu) {
        grad = ToFloat(y[i]) > 0 ? grad : 0.0f;
        Assign(grad, m.grad_identity + b.first + i);
      }
      const float normed = (ToFloat(x[i]) - mean[c]) * rstd[c];
      grad = Masked<kTail>(grad, normed);
      sum[c] += grad;
      products[c] += grad * normed;
    }
  }
}

template <NormTail kTail, typename T>
HOLDFAST_INLINE void ApplyGradientsToBlock(const NormMaps<T>& m, const Block& b) {
  const int64_t channels = m.channels;
  const float* __restrict mean = m.moments + b.map * 2 * channels;
  const float* __restrict rstd = mean + channels;
  const float* __restrict sum = m.sums + b.map * 2 * channels;
  const float* __restrict products = sum + channels;
  const T* __restrict x = m.x + b.first;
  // grad_identity holds the gradient behind the outer ReLU.
  const T* __restrict grad_y = (kTail == NormTail::kReluAddRelu ? m.grad_identity : m.grad_y) + b.first;
  T* __restrict grad_x = m.grad_x + b.first;
  for (int64_t p = 0; p < b.pixels; ++p) {
    for (int64_t c = 0; c < channels; ++c) {
      const int64_t i = p * channels + c;
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
