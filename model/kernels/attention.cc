// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/attention.h"

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

// Queries in flight: each key loaded serves five of them. Ten groups hold the 49 queries of a patch with one place to
// spare, and their sums for two registers of keys leave room among sixteen registers for what is multiplied.
constexpr int64_t kQueries = 5;
constexpr float kLog2OfE = 1.44269504f;

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

// One head of one frame: where its first channel of the first token is, and how tokens follow one another.
struct Head {
  int64_t offset;
  int64_t channels;  // D
};

template <typename T>
HOLDFAST_INLINE Head HeadOf(const AttentionMaps<T>& m, int64_t frame, int64_t head) {
  return {frame * m.height * m.width * m.channels + head * m.head_channels(), m.head_channels()};
}

// Scratch of one thread. A strip has the tokens of three rows of patches over the whole width, column after column of
// the map, so that the keys of a patch are neighbours: they begin at Keys::first.
struct Scratch {
  float* strip;        // [D, columns], zeros behind the last token
  float* tokens;       // [columns, depth]: the same, a token's channels together, zeros behind the last channel
  float* grad_strip;   // as 'strip'
  float* scores;       // [kQueries, keys]
  float* grad_scores;  // [kQueries, keys]
  float* queries;      // [kQueries, depth] scaled queries of the group
  float* outs;         // [kQueries, depth]
  float* grads;        // [kQueries, depth]
  int64_t columns;
  int64_t keys;
  int64_t depth;  // D rounded up to whole registers
};

struct Sizes {
  int64_t columns, keys, depth;
};

template <typename T>
HOLDFAST_INLINE Sizes SizesOf(const AttentionMaps<T>& m) {
  // Registers are read in pairs, which may go beyond the last key.
  return {RoundUp(3 * m.patch * m.width, kMaxLanes) + 2 * kMaxLanes,
          RoundUp(9 * m.patch * m.patch, kMaxLanes) + 2 * kMaxLanes, RoundUp(m.head_channels(), kMaxLanes)};
}

template <typename T>
HOLDFAST_INLINE Scratch Divide(const AttentionMaps<T>& m, float* memory) {
  const Sizes sizes = SizesOf(m);
  Scratch s;
  s.columns = sizes.columns;
  s.keys = sizes.keys;
  s.depth = sizes.depth;
  s.strip = memory;
  s.tokens = s.strip + s.columns * m.head_channels();
  s.scores = s.tokens + s.columns * s.depth;
  s.grad_scores = s.scores + kQueries * s.keys;
  s.queries = s.grad_scores + kQueries * s.keys;
  s.outs = s.queries + kQueries * s.depth;
  s.grads = s.outs + kQueries * s.depth;
  s.grad_strip = s.grads + kQueries * s.depth;
  return s;
}

// A token of the map into column j of the strip.
template <int64_t kWidth, typename T>
HOLDFAST_INLINE void GatherToken(const T* token, int64_t channels, int64_t j, const Scratch& s) {
  float* copy = s.tokens + j * s.depth;
  float* column = s.strip + j;
  int64_t d = 0;
  for (; d + kWidth <= channels; d += kWidth) {
    const Lanes<kWidth> values = Load<kWidth>(token + d);
    Store(values, copy + d);
    for (int64_t i = 0; i < kWidth; ++i) column[(d + i) * s.columns] = values[i];
  }
  for (; d < channels; ++d) column[d * s.columns] = copy[d] = ToFloat(token[d]);
  for (; d < s.depth; ++d) copy[d] = 0;
}

// A few columns of the map at a time: as many tokens of a row are read together, and what is written stays in the
// cache.
template <int64_t kWidth, typename T>
HOLDFAST_INLINE void GatherStrip(const AttentionMaps<T>& m, const Head& head, const Region& strip, const Scratch& s) {
  constexpr int64_t kColumns = 8;
  const int64_t rows = strip.y1 - strip.y0;
  for (int64_t left = 0; left < m.width; left += kColumns) {
    for (int64_t y = strip.y0; y < strip.y1; ++y) {
      for (int64_t x = left; x < std::min(left + kColumns, m.width); ++x) {
        const T* token = m.value + head.offset + (y * m.width + x) * m.channels;
        GatherToken<kWidth>(token, head.channels, x * rows + y - strip.y0, s);
      }
    }
  }
  for (int64_t d = 0; d < head.channels; ++d) {
    std::fill(s.strip + d * s.columns + m.width * rows, s.strip + (d + 1) * s.columns, 0.0f);
  }
}

// Token 'i' of a region: its offset in a map.
template <typename T>
HOLDFAST_INLINE int64_t TokenAt(const AttentionMaps<T>& m, const Head& head, const Region& region, int64_t i) {
  const int64_t width = region.x1 - region.x0;
  return head.offset + ((region.y0 + i / width) * m.width + region.x0 + i % width) * m.channels;
}

// to[i] = scale * from[i] for 'count' values; 'to' is rounded.
template <int64_t kWidth, typename From, typename To>
HOLDFAST_INLINE void Scale(const From* from, int64_t count, float scale, To* to) {
  int64_t i = 0;
  for (; i + kWidth <= count; i += kWidth) Store(scale * Load<kWidth>(from + i), to + i);
  for (; i < count; ++i) Assign(scale * ToFloat(from[i]), to + i);
}

// Tokens first .. first + kQueries - 1 of a map, times 'scale'; zeros behind the region's last.
template <int64_t kWidth, typename T>
HOLDFAST_INLINE void GatherTokens(const AttentionMaps<T>& m, const Head& head, const Region& region, int64_t first,
                                  const T* map, float scale, float* out) {
  const int64_t depth = RoundUp(head.channels, kMaxLanes);
  std::fill_n(out, kQueries * depth, 0.0f);
  for (int64_t q = 0; q < std::min(kQueries, region.count() - first); ++q) {
    const T* token = map + TokenAt(m, head, region, first + q);
    Scale<kWidth>(token, head.channels, scale, out + q * depth);
  }
}

// The keys of a patch: 'count' columns of the strip from 'first' on.
struct Keys {
  int64_t first;
  int64_t count;
};

HOLDFAST_INLINE Keys KeysOf(const Region& region) { return {region.x0 * (region.y1 - region.y0), region.count()}; }

// One row after the other, each 'stride' floats behind the one before.
template <typename T>
struct Matrix {
  T* first;
  int64_t stride;
};

// out[q, .] = sum_i left[q, i] * right[i, .] for two registers' columns: each value of 'left' loaded serves both.
template <int64_t kWidth>
HOLDFAST_INLINE void TimesPair(const Matrix<const float>& left, const Matrix<const float>& right, int64_t count,
                               const Matrix<float>& out) {
  using V = Lanes<kWidth>;
  V low[kQueries] = {};
  V high[kQueries] = {};
  for (int64_t i = 0; i < count; ++i) {
    const V first = Load<kWidth>(right.first + i * right.stride);
    const V second = Load<kWidth>(right.first + i * right.stride + kWidth);
    for (int64_t q = 0; q < kQueries; ++q) {
      low[q] += left.first[q * left.stride + i] * first;
      high[q] += left.first[q * left.stride + i] * second;
    }
  }
  for (int64_t q = 0; q < kQueries; ++q) {
    Store(low[q], out.first + q * out.stride);
    Store(high[q], out.first + q * out.stride + kWidth);
  }
}

// products[q, j] = sum_d left[q, d] * strip[d, keys.first + j] for all keys, and what the last registers hold besides.
template <int64_t kWidth>
HOLDFAST_INLINE void TimesKeys(const float* left, const Keys& keys, int64_t channels, const Scratch& s,
                               float* products) {
  for (int64_t j = 0; j < keys.count; j += 2 * kWidth) {
    TimesPair<kWidth>({left, s.depth}, {s.strip + keys.first + j, s.columns}, channels, {products + j, s.keys});
  }
}

// out[q, d] = sum_j weights[q, j] * tokens[keys.first + j, d] for a register's channels from 'd' on. Two sums for each,
// of every other key: one alone would wait for itself.
template <int64_t kWidth>
HOLDFAST_INLINE void TimesTokens(const float* weights, const Keys& keys, int64_t d, const Scratch& s, float* out) {
  using V = Lanes<kWidth>;
  V even[kQueries] = {};
  V odd[kQueries] = {};
  const float* token = s.tokens + keys.first * s.depth + d;
  int64_t j = 0;
  for (; j + 2 <= keys.count; j += 2) {
    const V first = Load<kWidth>(token + j * s.depth);
    const V second = Load<kWidth>(token + (j + 1) * s.depth);
    for (int64_t q = 0; q < kQueries; ++q) {
      even[q] += weights[q * s.keys + j] * first;
      odd[q] += weights[q * s.keys + j + 1] * second;
    }
  }
  if (j < keys.count) {
    const V last = Load<kWidth>(token + j * s.depth);
    for (int64_t q = 0; q < kQueries; ++q) even[q] += weights[q * s.keys + j] * last;
  }
  for (int64_t q = 0; q < kQueries; ++q) Store(even[q] + odd[q], out + q * s.depth + d);
}

// The same for two registers' channels.
template <int64_t kWidth>
HOLDFAST_INLINE void TimesWideTokens(const float* weights, const Keys& keys, int64_t d, const Scratch& s, float* out) {
  TimesPair<kWidth>({weights, s.keys}, {s.tokens + keys.first * s.depth + d, s.depth}, keys.count, {out + d, s.depth});
}

template <int64_t kWidth>
HOLDFAST_INLINE void TimesAllTokens(const float* weights, const Keys& keys, int64_t channels, const Scratch& s,
                                    float* out) {
  int64_t d = 0;
  for (; d + kWidth < channels; d += 2 * kWidth) TimesWideTokens<kWidth>(weights, keys, d, s, out);
  if (d < channels) TimesTokens<kWidth>(weights, keys, d, s, out);
}

// The first 'count' scores become 2^(score - largest), those up to a whole register next to nothing. Returns 1 / sum.
template <int64_t kWidth>
HOLDFAST_INLINE float Exponentials(float* scores, int64_t count) {
  using V = Lanes<kWidth>;
  const int64_t used = RoundUp(count, kWidth);
  for (int64_t j = count; j < used; ++j) scores[j] = -1e30f;
  V largest = Load<kWidth>(scores);
  for (int64_t j = kWidth; j < used; j += kWidth) largest = Max(largest, Load<kWidth>(scores + j));
  const float top = Largest(largest);
  V total = {};
  for (int64_t j = 0; j < used; j += kWidth) {
    const V weight = Exp2OfNegative(Load<kWidth>(scores + j) - top);
    Store(weight, scores + j);
    total += weight;
  }
  return 1.0f / Sum(total);
}

// Weights of kQueries queries into s.scores; 'scales' are what they are to be multiplied with to give 1 in all.
template <int64_t kWidth, typename T>
HOLDFAST_INLINE void Weigh(const AttentionMaps<T>& m, const Head& head, const Region& queries, int64_t first,
                           const Keys& keys, const Scratch& s, float* scales) {
  const float scale = kLog2OfE / std::sqrt(static_cast<float>(head.channels));
  GatherTokens<kWidth>(m, head, queries, first, m.query, scale, s.queries);
  TimesKeys<kWidth>(s.queries, keys, head.channels, s, s.scores);
  for (int64_t q = 0; q < kQueries; ++q) scales[q] = Exponentials<kWidth>(s.scores + q * s.keys, keys.count);
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void AttendPatch(const AttentionMaps<T>& m, const Head& head, int64_t row, int64_t column,
                                 const Scratch& s) {
  const Region queries = RegionOf(m, row, column, 0);
  const Keys keys = KeysOf(RegionOf(m, row, column, 1));
  for (int64_t first = 0; first < queries.count(); first += kQueries) {
    float scales[kQueries];
    Weigh<kWidth>(m, head, queries, first, keys, s, scales);
    TimesAllTokens<kWidth>(s.scores, keys, head.channels, s, s.outs);
    for (int64_t q = 0; q < std::min(kQueries, queries.count() - first); ++q) {
      T* token = m.out + TokenAt(m, head, queries, first + q);
      Scale<kWidth>(s.outs + q * s.depth, head.channels, scales[q], token);
    }
  }
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void Attend(const AttentionMaps<T>& m, float* memory, int64_t begin, int64_t end) {
  const Scratch scratch = Divide(m, memory);
  for (int64_t item = begin; item < end; ++item) {
    const int64_t row = item % m.patch_rows();
    const int64_t map = item / m.patch_rows();
    const Head head = HeadOf(m, map / m.heads, map % m.heads);
    GatherStrip<kWidth>(m, head, RegionOf(m, row, 0, 1), scratch);
    for (int64_t column = 0; column < m.patch_columns(); ++column) AttendPatch<kWidth>(m, head, row, column, scratch);
  }
}

// Turns s.scores into weights and s.grad_scores (gradients of the weights) into gradients of the scores.
template <int64_t kWidth>
HOLDFAST_INLINE void SoftmaxBackward(int64_t count, const float* scales, const Scratch& s) {
  for (int64_t q = 0; q < kQueries; ++q) {
    float shift = 0;  // sum_j weight_j * grad_j
    for (int64_t d = 0; d < s.depth; ++d) shift += s.grads[q * s.depth + d] * s.outs[q * s.depth + d];
    for (int64_t j = 0; j < count; j += kWidth) {
      float* grad = s.grad_scores + q * s.keys + j;
      float* weight = s.scores + q * s.keys + j;
      Store(scales[q] * Load<kWidth>(weight), weight);
      Store(Load<kWidth>(weight) * (Load<kWidth>(grad) - shift), grad);
    }
    // What the last register holds besides is no key's.
    for (int64_t j = count; j < RoundUp(count, kWidth); ++j) s.scores[q * s.keys + j] = 0;
    for (int64_t j = count; j < RoundUp(count, kWidth); ++j) s.grad_scores[q * s.keys + j] = 0;
  }
}

// A token is key (through the scores) and value (through the weights) at once.
template <int64_t kWidth>
HOLDFAST_INLINE void AddKeyGradients(const Keys& keys, int64_t channels, const Scratch& s) {
  using V = Lanes<kWidth>;
  for (int64_t j = 0; j < keys.count; j += kWidth) {
    V weights[kQueries];
    V grads[kQueries];
    for (int64_t q = 0; q < kQueries; ++q) {
      weights[q] = Load<kWidth>(s.scores + q * s.keys + j);
      grads[q] = Load<kWidth>(s.grad_scores + q * s.keys + j);
    }
    for (int64_t d = 0; d < channels; ++d) {
      float* sum = s.grad_strip + d * s.columns + keys.first + j;
      V value = Load<kWidth>(sum);
      for (int64_t q = 0; q < kQueries; ++q) {
        value += s.queries[q * s.depth + d] * grads[q] + s.grads[q * s.depth + d] * weights[q];
      }
      Store(value, sum);
    }
  }
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void AttendPatchBackward(const AttentionMaps<T>& m, const Head& head, int64_t row, int64_t column,
                                         const Scratch& s) {
  const Region queries = RegionOf(m, row, column, 0);
  const Keys keys = KeysOf(RegionOf(m, row, column, 1));
  const int64_t depth = head.channels;
  const float scale = 1.0f / std::sqrt(static_cast<float>(depth));
  for (int64_t first = 0; first < queries.count(); first += kQueries) {
    float scales[kQueries];
    Weigh<kWidth>(m, head, queries, first, keys, s, scales);
    GatherTokens<kWidth>(m, head, queries, first, m.query, scale, s.queries);
    GatherTokens<kWidth, T>(m, head, queries, first, m.out, 1.0f, s.outs);
    GatherTokens<kWidth>(m, head, queries, first, m.grad_out, 1.0f, s.grads);
    TimesKeys<kWidth>(s.grads, keys, depth, s, s.grad_scores);
    SoftmaxBackward<kWidth>(keys.count, scales, s);
    AddKeyGradients<kWidth>(keys, depth, s);
    TimesAllTokens<kWidth>(s.grad_scores, keys, depth, s, s.outs);
    for (int64_t q = 0; q < std::min(kQueries, queries.count() - first); ++q) {
      float* token = m.grad_query + TokenAt(m, head, queries, first + q);
      Scale<kWidth>(s.outs + q * s.depth, depth, scale, token);
    }
  }
}

template <typename T>
HOLDFAST_INLINE void ScatterStripGradients(const AttentionMaps<T>& m, const Head& head, const Region& strip,
                                           const Scratch& s) {
  int64_t j = 0;
  for (int64_t x = 0; x < m.width; ++x) {
    for (int64_t y = strip.y0; y < strip.y1; ++y, ++j) {
      float* token = m.grad_value + head.offset + (y * m.width + x) * m.channels;
      for (int64_t d = 0; d < head.channels; ++d) token[d] += s.grad_strip[d * s.columns + j];
    }
  }
}

template <int64_t kWidth, typename T>
HOLDFAST_INLINE void AttendBackward(const AttentionMaps<T>& m, float* memory, int64_t begin, int64_t end) {
  const Scratch scratch = Divide(m, memory);
  for (int64_t item = begin; item < end; ++item) {
    const Head head = HeadOf(m, item / m.heads, item % m.heads);
    for (int64_t row = 0; row < m.patch_rows(); ++row) {
      const Region strip = RegionOf(m, row, 0, 1);
      GatherStrip<kWidth>(m, head, strip, scratch);
      std::fill_n(scratch.grad_strip, head.channels * scratch.columns, 0.0f);
      for (int64_t column = 0; column < m.patch_columns(); ++column) {
        AttendPatchBackward<kWidth>(m, head, row, column, scratch);
      }
      ScatterStripGradients(m, head, strip, scratch);
    }
  }
}

}  // namespace

template <typename T>
int64_t AttentionMaps<T>::scratch_floats() const {
  const Sizes sizes = SizesOf(*this);
  return sizes.columns * (2 * head_channels() + sizes.depth) + kQueries * (2 * sizes.keys + 3 * sizes.depth);
}
template struct AttentionMaps<float>;
template struct AttentionMaps<Bf16>;

HOLDFAST_KERNEL(AttendItems, (const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end), Attend,
                (maps, scratch, begin, end))
HOLDFAST_KERNEL(AttendItems, (const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end), Attend,
                (maps, scratch, begin, end))
HOLDFAST_KERNEL(AttendBackwardItems, (const AttentionMaps<float>& maps, float* scratch, int64_t begin, int64_t end),
                AttendBackward, (maps, scratch, begin, end))
HOLDFAST_KERNEL(AttendBackwardItems, (const AttentionMaps<Bf16>& maps, float* scratch, int64_t begin, int64_t end),
                AttendBackward, (maps, scratch, begin, end))

}  // namespace holdfast
