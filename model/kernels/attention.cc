// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/attention.h"

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

constexpr int64_t kQueries = 4;  // queries in flight: each key loaded serves four of them

// Tokens [y0, y1) x [x0, x1) of one map.
struct Region {
  int64_t y0, y1, x0, x1;
  int64_t count() const { return (y1 - y0) * (x1 - x0); }
};

// The patch (row, column) with 'margin' patches around it, cut to the map.
template <typename T>
HOLDFAST_INLINE Region RegionOf(const AttentionMaps<T>& m, int64_t row, int64_t column, int64_t margin) {
  return {std::max<int64_t>(0, (row - margin) * m.patch), std::min(m.height, (row + margin + 1) * m.patch),
          std::max<int64_t>(0, (column - margin) * m.patch), std::min(m.width, (column + margin + 1) * m.patch)};
}

HOLDFAST_INLINE int64_t RoundUp(int64_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

// One head of one frame: where its first channel of the first token is, and how tokens follow one another.
struct Head {
  int64_t offset;
  int64_t channels;
};

template <typename T>
HOLDFAST_INLINE Head HeadOf(const AttentionMaps<T>& m, int64_t frame, int64_t head) {
  return {frame * m.height * m.width * m.channels + head * m.head_channels(), m.head_channels()};
}

// Scratch of one thread, for at most 'keys' keys.
struct Scratch {
  float* keys;         // [D, columns]: the region's tokens, transposed, zeros behind the last
  float* scores;       // [kQueries, columns]
  float* grad_keys;    // [D, columns]
  float* grad_scores;  // [kQueries, columns]
  float* queries;      // [kQueries, D] scaled queries of the group
  float* outs;         // [kQueries, D]
  float* grads;        // [kQueries, D]
  int64_t columns;
};

template <typename T>
HOLDFAST_INLINE Scratch Divide(const AttentionMaps<T>& m, float* memory) {
  const int64_t columns = RoundUp(9 * m.patch * m.patch);
  const int64_t depth = m.head_channels();
  Scratch s;
  s.columns = columns;
  s.keys = memory;
  s.scores = s.keys + depth * columns;
  s.grad_keys = s.scores + kQueries * columns;
  s.grad_scores = s.grad_keys + depth * columns;
  s.queries = s.grad_scores + kQueries * columns;
  s.outs = s.queries + kQueries * depth;
  s.grads = s.outs + kQueries * depth;
  return s;
}

template <typename T>
HOLDFAST_INLINE void GatherKeys(const AttentionMaps<T>& m, const Head& head, const Region& region, const Scratch& s) {
  int64_t j = 0;
  for (int64_t y = region.y0; y < region.y1; ++y) {
    for (int64_t x = region.x0; x < region.x1; ++x, ++j) {
      const T* token = m.value + head.offset + (y * m.width + x) * m.channels;
      for (int64_t d = 0; d < head.channels; ++d) s.keys[d * s.columns + j] = ToFloat(token[d]);
    }
  }
  for (int64_t d = 0; d < head.channels; ++d) std::fill(s.keys + d * s.columns + j, s.keys + (d + 1) * s.columns, 0.0f);
}

// Token 'i' of a region: its offset in a map.
template <typename T>
HOLDFAST_INLINE int64_t TokenAt(const AttentionMaps<T>& m, const Head& head, const Region& region, int64_t i) {
  const int64_t width = region.x1 - region.x0;
  return head.offset + ((region.y0 + i / width) * m.width + region.x0 + i % width) * m.channels;
}

// Tokens first .. first + kQueries - 1 of a map, times 'scale'; zeros behind the region's last.
template <typename T>
HOLDFAST_INLINE void GatherTokens(const AttentionMaps<T>& m, const Head& head, const Region& region, int64_t first,
                                  const T* map, float scale, float* out) {
  std::fill_n(out, kQueries * head.channels, 0.0f);
  for (int64_t q = 0; q < std::min(kQueries, region.count() - first); ++q) {
    const T* token = map + TokenAt(m, head, region, first + q);
    for (int64_t d = 0; d < head.channels; ++d) out[q * head.channels + d] = scale * ToFloat(token[d]);
  }
}

// products[q, j] = sum_d left[q, d] * keys[d, j], for j below 'used', a multiple of kLanes.
HOLDFAST_INLINE void TimesKeys(const float* left, const float* keys, int64_t depth, int64_t columns, int64_t used,
                               float* products) {
  for (int64_t j = 0; j < used; j += kLanes) {
    Lanes sums[kQueries] = {};
    for (int64_t d = 0; d < depth; ++d) {
      const Lanes key = Load(keys + d * columns + j);
      for (int64_t q = 0; q < kQueries; ++q) sums[q] += left[q * depth + d] * key;
    }
    for (int64_t q = 0; q < kQueries; ++q) Store(sums[q], products + q * columns + j);
  }
}

// out[q, d] = sum_j weights[q, j] * keys[d, j]
HOLDFAST_INLINE void TimesKeysTransposed(const float* weights, const float* keys, int64_t depth, int64_t columns,
                                         int64_t used, float* out) {
  for (int64_t d = 0; d < depth; ++d) {
    Lanes sums[kQueries] = {};
    for (int64_t j = 0; j < used; j += kLanes) {
      const Lanes key = Load(keys + d * columns + j);
      for (int64_t q = 0; q < kQueries; ++q) sums[q] += Load(weights + q * columns + j) * key;
    }
    for (int64_t q = 0; q < kQueries; ++q) out[q * depth + d] = Sum(sums[q]);
  }
}

// Softmax over the first 'count' scores; those up to 'used' become zero.
HOLDFAST_INLINE void Softmax(float* scores, int64_t count, int64_t used) {
  for (int64_t j = count; j < used; ++j) scores[j] = -1e30f;
  Lanes largest = Load(scores);
  for (int64_t j = kLanes; j < used; j += kLanes) largest = Max(largest, Load(scores + j));
  float top = largest[0];
  for (int64_t i = 1; i < kLanes; ++i) top = std::max(top, largest[i]);
  Lanes total = {};
  for (int64_t j = 0; j < used; j += kLanes) {
    const Lanes weight = ExpOfNegative(Load(scores + j) - top);
    Store(weight, scores + j);
    total += weight;
  }
  float sum = Sum(total);
  for (int64_t j = count; j < used; ++j) sum -= scores[j];
  for (int64_t j = count; j < used; ++j) scores[j] = 0;
  const float scale = 1.0f / sum;
  for (int64_t j = 0; j < used; j += kLanes) Store(Load(scores + j) * scale, scores + j);
}

// Weights of kQueries queries into s.scores.
template <typename T>
HOLDFAST_INLINE void Weigh(const AttentionMaps<T>& m, const Head& head, const Region& queries, int64_t first,
                           int64_t keys, const Scratch& s) {
  const float scale = 1.0f / std::sqrt(static_cast<float>(head.channels));
  const int64_t used = RoundUp(keys);
  GatherTokens(m, head, queries, first, m.query, scale, s.queries);
  TimesKeys(s.queries, s.keys, head.channels, s.columns, used, s.scores);
  for (int64_t q = 0; q < kQueries; ++q) Softmax(s.scores + q * s.columns, keys, used);
}

template <typename T>
HOLDFAST_INLINE void AttendPatch(const AttentionMaps<T>& m, const Head& head, int64_t row, int64_t column,
                                 const Scratch& s) {
  const Region queries = RegionOf(m, row, column, 0);
  const Region keys = RegionOf(m, row, column, 1);
  GatherKeys(m, head, keys, s);
  for (int64_t first = 0; first < queries.count(); first += kQueries) {
    Weigh(m, head, queries, first, keys.count(), s);
    TimesKeysTransposed(s.scores, s.keys, head.channels, s.columns, RoundUp(keys.count()), s.outs);
    for (int64_t q = 0; q < std::min(kQueries, queries.count() - first); ++q) {
      T* token = m.out + TokenAt(m, head, queries, first + q);
      for (int64_t d = 0; d < head.channels; ++d) Assign(s.outs[q * head.channels + d], token + d);
    }
  }
}

template <typename T>
HOLDFAST_INLINE void Attend(const AttentionMaps<T>& m, float* memory, int64_t begin, int64_t end) {
  const Scratch scratch = Divide(m, memory);
  for (int64_t item = begin; item < end; ++item) {
    const int64_t row = item % m.patch_rows();
    const int64_t map = item / m.patch_rows();
    const Head head = HeadOf(m, map / m.heads, map % m.heads);
    for (int64_t column = 0; column < m.patch_columns(); ++column) AttendPatch(m, head, row, column, scratch);
  }
}

// Turns s.grad_scores (gradients of the weights) into gradients of the scores.
HOLDFAST_INLINE void SoftmaxBackward(int64_t depth, int64_t used, const Scratch& s) {
  for (int64_t q = 0; q < kQueries; ++q) {
    float shift = 0;  // sum_j weight_j * grad_j
    for (int64_t d = 0; d < depth; ++d) shift += s.grads[q * depth + d] * s.outs[q * depth + d];
    for (int64_t j = 0; j < used; j += kLanes) {
      float* grad = s.grad_scores + q * s.columns + j;
      Store(Load(s.scores + q * s.columns + j) * (Load(grad) - shift), grad);
    }
  }
}

// A token is key (through the scores) and value (through the weights) at once.
HOLDFAST_INLINE void AddKeyGradients(int64_t depth, int64_t used, const Scratch& s) {
  for (int64_t d = 0; d < depth; ++d) {
    for (int64_t j = 0; j < used; j += kLanes) {
      Lanes sum = Load(s.grad_keys + d * s.columns + j);
      for (int64_t q = 0; q < kQueries; ++q) {
        sum += s.queries[q * depth + d] * Load(s.grad_scores + q * s.columns + j) +
               s.grads[q * depth + d] * Load(s.scores + q * s.columns + j);
      }
      Store(sum, s.grad_keys + d * s.columns + j);
    }
  }
}

template <typename T>
HOLDFAST_INLINE void ScatterKeyGradients(const AttentionMaps<T>& m, const Head& head, const Region& keys,
                                         const Scratch& s) {
  for (int64_t j = 0; j < keys.count(); ++j) {
    float* token = m.grad_value + TokenAt(m, head, keys, j);
    for (int64_t d = 0; d < head.channels; ++d) token[d] += s.grad_keys[d * s.columns + j];
  }
}

template <typename T>
HOLDFAST_INLINE void AttendPatchBackward(const AttentionMaps<T>& m, const Head& head, int64_t row, int64_t column,
                                         const Scratch& s) {
  const Region queries = RegionOf(m, row, column, 0);
  const Region keys = RegionOf(m, row, column, 1);
  const int64_t depth = head.channels;
  const int64_t used = RoundUp(keys.count());
  const float scale = 1.0f / std::sqrt(static_cast<float>(depth));
  GatherKeys(m, head, keys, s);
  std::fill_n(s.grad_keys, depth * s.columns, 0.0f);
  for (int64_t first = 0; first < queries.count(); first += kQueries) {
    Weigh(m, head, queries, first, keys.count(), s);
    GatherTokens<T>(m, head, queries, first, m.out, 1.0f, s.outs);
    GatherTokens(m, head, queries, first, m.grad_out, 1.0f, s.grads);
    TimesKeys(s.grads, s.keys, depth, s.columns, used, s.grad_scores);
    SoftmaxBackward(depth, used, s);
    AddKeyGradients(depth, used, s);
    TimesKeysTransposed(s.grad_scores, s.keys, depth, s.columns, used, s.outs);
    for (int64_t q = 0; q < std::min(kQueries, queries.count() - first); ++q) {
      float* token = m.grad_query + TokenAt(m, head, queries, first + q);
      for (int64_t d = 0; d < depth; ++d) token[d] = scale * s.outs[q * depth + d];
    }
  }
  ScatterKeyGradients(m, head, keys, s);
}

template <typename T>
HOLDFAST_INLINE void AttendBackward(const AttentionMaps<T>& m, float* memory, int64_t begin, int64_t end) {
  const Scratch scratch = Divide(m, memory);
  for (int64_t item = begin; item < end; ++item) {
    const Head head = HeadOf(m, item / m.heads, item % m.heads);
    for (int64_t row = 0; row < m.patch_rows(); ++row) {
      for (int64_t column = 0; column < m.patch_columns(); ++column) {
        AttendPatchBackward(m, head, row, column, scratch);
      }
    }
  }
}

}  // namespace

template <typename T>
int64_t AttentionMaps<T>::scratch_floats() const {
  const int64_t columns = RoundUp(9 * patch * patch);
  return 2 * (head_channels() + kQueries) * columns + 3 * kQueries * head_channels();
}
template struct AttentionMaps<float>;
template struct AttentionMaps<Bf16>;

HOLDFAST_SIMD void AttendItems(const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end) {
  Attend(maps, scratch, begin, end);
}
HOLDFAST_SIMD void AttendItems(const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end) {
  Attend(maps, scratch, begin, end);
}
HOLDFAST_SIMD void AttendBackwardItems(const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end) {
  AttendBackward(maps, scratch, begin, end);
}
HOLDFAST_SIMD void AttendBackwardItems(const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end) {
  AttendBackward(maps, scratch, begin, end);
}

}  // namespace holdfast
