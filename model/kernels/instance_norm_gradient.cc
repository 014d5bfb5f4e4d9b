// SPDX-License-Identifier: Apache-2.0
// The backward pass of instance_norm.h.
#include <algorithm>

#include "model/kernels/instance_norm.h"
#include "model/kernels/norm_blocks.h"

namespace holdfast {
namespace {

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

// kWidth columns at once; compilers leave the loop below scalar for its choices.
template <int64_t kWidth, NormTail kTail, typename T>
HOLDFAST_INLINE void SumLanes(const GradientColumns<T>& at, int64_t i, int64_t c) {
  Lanes<kWidth> grad = Load<kWidth>(at.grad_y + i);
  if (kTail == NormTail::kReluAddRelu) {
    grad = Load<kWidth>(at.y + i) > 0 ? grad : Lanes<kWidth>{};
    Store(grad, at.grad_identity + i);
  }
  const Lanes<kWidth> normed = (Load<kWidth>(at.x + i) - Load<kWidth>(at.mean + c)) * Load<kWidth>(at.rstd + c);
  if (kTail != NormTail::kNone) grad = normed > 0 ? grad : Lanes<kWidth>{};
  Store(Load<kWidth>(at.sum + c) + grad, at.sum + c);
  Store(Load<kWidth>(at.products + c) + grad * normed, at.products + c);
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

template <int64_t kWidth, NormTail kTail, typename T>
HOLDFAST_INLINE void SumGradients(const NormMaps<T>& m, const Block& b, const Fold& fold, float* sum, float* products) {
  WideMoments w;
  WidenMoments(m.moments + b.map * 2 * m.channels, fold, w);
  T* grad_identity = kTail == NormTail::kReluAddRelu ? m.grad_identity + b.first : nullptr;
  const GradientColumns<T> at = {m.x + b.first, m.y + b.first, m.grad_y + b.first, grad_identity, w.mean, w.rstd,
                                 sum,           products};
  std::fill_n(sum, fold.width, 0.0f);
  std::fill_n(products, fold.width, 0.0f);
  for (int64_t r = 0; r < fold.rows; ++r) {
    int64_t c = 0;
    for (; c + kWidth <= fold.width; c += kWidth) SumLanes<kWidth, kTail>(at, r * fold.width + c, c);
    for (; c < fold.width; ++c) SumColumn<kTail>(at, r * fold.width + c, c);
  }
}

template <int64_t kWidth, NormTail kTail, typename T>
HOLDFAST_INLINE void GradientsOfBlock(const NormMaps<T>& m, const Block& b, float* sum, float* products) {
  const Fold fold = FoldOf(b.pixels, m.channels);
  if (fold.fold == 1) return SumGradients<kWidth, kTail>(m, b, fold, sum, products);
  float wide_sum[kMaxWidth] = {};
  float wide_products[kMaxWidth] = {};
  SumGradients<kWidth, kTail>(m, b, fold, wide_sum, wide_products);
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

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void BlockGradients(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block block = BlockAt(i, m.pixels, m.channels);
    float* sum = m.partial + i * 2 * m.channels;
    float* products = sum + m.channels;
    if (m.tail == NormTail::kNone) GradientsOfBlock<kWidth, NormTail::kNone>(m, block, sum, products);
    if (m.tail == NormTail::kRelu) GradientsOfBlock<kWidth, NormTail::kRelu>(m, block, sum, products);
    if (m.tail == NormTail::kReluAddRelu) GradientsOfBlock<kWidth, NormTail::kReluAddRelu>(m, block, sum, products);
  }
}

template <int64_t, typename T>
HOLDFAST_INLINE void ApplyGradients(const NormMaps<T>& m, int64_t begin, int64_t end) {
  for (int64_t i = begin; i < end; ++i) {
    const Block block = BlockAt(i, m.pixels, m.channels);
    if (m.tail == NormTail::kNone) ApplyGradientsToBlock<NormTail::kNone>(m, block);
    if (m.tail == NormTail::kRelu) ApplyGradientsToBlock<NormTail::kRelu>(m, block);
    if (m.tail == NormTail::kReluAddRelu) ApplyGradientsToBlock<NormTail::kReluAddRelu>(m, block);
  }
}

}  // namespace

HOLDFAST_KERNEL(NormBlockGradients, (const NormMaps<float>& maps, int64_t begin, int64_t end), BlockGradients,
                (maps, begin, end))
HOLDFAST_KERNEL(NormBlockGradients, (const NormMaps<Bf16>& maps, int64_t begin, int64_t end), BlockGradients,
                (maps, begin, end))
HOLDFAST_KERNEL(NormApplyGradients, (const NormMaps<float>& maps, int64_t begin, int64_t end), ApplyGradients,
                (maps, begin, end))
HOLDFAST_KERNEL(NormApplyGradients, (const NormMaps<Bf16>& maps, int64_t begin, int64_t end), ApplyGradients,
                (maps, begin, end))

void NormJoinGradients(const float* partial, int64_t pixels, int64_t channels, float* sums) {
  const int64_t blocks = NormBlocks(pixels);
  for (int64_t c = 0; c < 2 * channels; ++c) {
    double sum = 0;
    for (int64_t b = 0; b < blocks; ++b) sum += partial[b * 2 * channels + c];
    sums[c] = static_cast<float>(sum / static_cast<double>(pixels));
  }
}

}  // namespace holdfast
