// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/instance_norm.h"

#include <algorithm>
#include <cmath>

#include "model/kernels/norm_blocks.h"

namespace holdfast {
namespace {

template <int64_t, typename T>
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
      if (kTail != NormTail::kNone) value = Relu(value);
      if (kTail == NormTail::kReluAddRelu) {
        value += ToFloat(identity[i]);
        value = Relu(value);
      }
      Assign(value, y + i);
    }
  }
}

template <int64_t, typename T>
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

}  // namespace

HOLDFAST_KERNEL(NormBlockMoments, (const NormMaps<float>& maps, int64_t begin, int64_t end), BlockMoments,
                (maps, begin, end))
HOLDFAST_KERNEL(NormBlockMoments, (const NormMaps<Bf16>& maps, int64_t begin, int64_t end), BlockMoments,
                (maps, begin, end))
HOLDFAST_KERNEL(NormApply, (const NormMaps<float>& maps, int64_t begin, int64_t end), Apply, (maps, begin, end))
HOLDFAST_KERNEL(NormApply, (const NormMaps<Bf16>& maps, int64_t begin, int64_t end), Apply, (maps, begin, end))

// Joins means and sums of squares pairwise (Chan et al.): exact where sums of squares would cancel.
void NormJoinMoments(const float* partial, const NormedPixels& pixels, int64_t channels, float* moments) {
  const int64_t blocks = (pixels.all + pixels.block - 1) / pixels.block;
  for (int64_t c = 0; c < channels; ++c) {
    double mean = 0;
    double squares = 0;
    double count = 0;
    for (int64_t b = 0; b < blocks; ++b) {
      const double size = static_cast<double>(std::min(pixels.block, pixels.all - b * pixels.block));
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

}  // namespace holdfast
