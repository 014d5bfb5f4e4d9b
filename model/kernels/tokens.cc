// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/tokens.h"

#include <cmath>

namespace holdfast {
namespace {

template <typename T>
HOLDFAST_INLINE float Mean(const T* x, int64_t channels, float sum, int64_t done) {
  for (; done < channels; ++done) sum += ToFloat(x[done]);
  return sum / static_cast<float>(channels);
}

// Mean and mean square distance from it of one token.
struct TokenMoments {
  float mean;
  float variance;
};

template <int64_t kWidth, typename T>
HOLDFAST_INLINE TokenMoments MomentsOf(const T* x, int64_t channels) {
  using V = Lanes<kWidth>;
  V sums = {};
  int64_t c = 0;
  for (; c + kWidth <= channels; c += kWidth) sums += Load<kWidth>(x + c);
  const float mean = Mean(x, channels, Sum(sums), c);
  V squares = {};
  for (c = 0; c + kWidth <= channels; c += kWidth) {
    const V d = Load<kWidth>(x + c) - mean;
    squares += d * d;
  }
  float total = Sum(squares);
  for (; c < channels; ++c) total += (ToFloat(x[c]) - mean) * (ToFloat(x[c]) - mean);
  return {mean, total / static_cast<float>(channels)};
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void NormAll(const NormedTokens<T>& tokens, int64_t begin, int64_t end) {
  const int64_t channels = tokens.channels;
  for (int64_t i = begin; i < end; ++i) {
    const T* x = tokens.x + i * channels;
    T* y = tokens.y + i * channels;
    const TokenMoments moments = MomentsOf<kWidth>(x, channels);
    const float scale = 1.0f / std::sqrt(moments.variance + tokens.epsilon);
    int64_t c = 0;
    for (; c + kWidth <= channels; c += kWidth) {
      const Lanes<kWidth> normed = (Load<kWidth>(x + c) - moments.mean) * scale;
      Store(normed * Load<kWidth>(tokens.weight + c) + Load<kWidth>(tokens.bias + c), y + c);
    }
    for (; c < channels; ++c) {
      Assign((ToFloat(x[c]) - moments.mean) * scale * tokens.weight[c] + tokens.bias[c], y + c);
    }
  }
}

// max(x, 0) - |x| / 2 * erfc(|x| / sqrt 2), with erfc after Abramowitz and Stegun 7.1.26: e^(-x^2 / 2) times a
// polynomial.
template <typename V>
HOLDFAST_INLINE V Gelu(V x) {
  const V size = Max(x, -x);
  const V t = 1.0f / (size * (0.3275911f * 0.70710678f) + 1.0f);
  V p = t * 1.061405429f - 1.453152027f;
  p = p * t + 1.421413741f;
  p = p * t - 0.284496736f;
  p = p * t + 0.254829592f;
  const V gauss = Exp2OfNegative(size * size * -0.72134752f);
  return Max(x, V{}) - size * 0.5f * (p * t * gauss);
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void GeluAll(T* x, int64_t begin, int64_t end) {
  int64_t i = begin;
  for (; i + kWidth <= end; i += kWidth) Store(Gelu(Load<kWidth>(x + i)), x + i);
  if (i == end) return;
  const Lanes<kWidth> last = Gelu(LoadTail<kWidth>(x + i, end - i));
  for (int64_t j = 0; i + j < end; ++j) Assign(last[j], x + i + j);
}

}  // namespace

HOLDFAST_KERNEL(NormTokens, (const NormedTokens<float>& tokens, int64_t begin, int64_t end), NormAll,
                (tokens, begin, end))
HOLDFAST_KERNEL(NormTokens, (const NormedTokens<Bf16>& tokens, int64_t begin, int64_t end), NormAll,
                (tokens, begin, end))
HOLDFAST_KERNEL(GeluValues, (float* x, int64_t begin, int64_t end), GeluAll, (x, begin, end))
HOLDFAST_KERNEL(GeluValues, (Bf16 * x, int64_t begin, int64_t end), GeluAll, (x, begin, end))

}  // namespace holdfast
