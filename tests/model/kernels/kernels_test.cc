// SPDX-License-Identifier: Apache-2.0
// The kernels against their definitions in plain loops, without torch: `.ci/arm64` runs this test where there is none.
// Their gradients, and tensors of every shape, are in tests/model/ops.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "model/kernels/attention.h"
#include "model/kernels/convolution.h"
#include "model/kernels/correlation.h"
#include "model/kernels/instance_norm.h"
#include "model/kernels/resize.h"
#include "model/kernels/simd.h"
#include "model/kernels/tokens.h"

namespace holdfast {
namespace {

using Floats = std::vector<float>;

// The same numbers on every machine, about -1 .. 1.
Floats Random(int64_t count, uint32_t seed) {
  Floats values(static_cast<size_t>(count));
  for (float& value : values) {
    seed = seed * 1664525u + 1013904223u;
    value = static_cast<float>(seed >> 8) / 8388608.0f - 1.0f;
  }
  return values;
}

std::vector<Bf16> ToHalf(const Floats& values) {
  std::vector<Bf16> halves(values.size());
  for (size_t i = 0; i < values.size(); ++i) Assign(values[i], &halves[i]);
  return halves;
}

double At(const Floats& values, int64_t i) { return values[static_cast<size_t>(i)]; }

void ExpectNear(const Floats& got, const std::vector<double>& want, double tolerance) {
  ASSERT_EQ(got.size(), want.size());
  double worst = 0;
  for (size_t i = 0; i < got.size(); ++i) {
    ASSERT_TRUE(std::isfinite(got[i])) << i;
    worst = std::max(worst, std::abs(got[i] - want[i]));
  }
  EXPECT_LE(worst, tolerance);
}

TEST(KernelsTest, OneDnnsVariablesAllowTheKernelsWhatTheyAllowOneDnn) {
  constexpr InstructionSet kBase = InstructionSet::kBase, kAvx2 = InstructionSet::kAvx2, kAll = InstructionSet::kAvx512;
  EXPECT_EQ(AllowedInstructionSet(nullptr, nullptr), kAll);
  for (const auto& [value, allowed] : {std::pair{"SSE41", kBase},
                                       {"sse41", kBase},
                                       {"AVX", kBase},
                                       {"AVX2", kAvx2},
                                       {"Avx2", kAvx2},
                                       {"avx2_vnni", kAvx2},
                                       {"AVX512_CORE", kAll},
                                       {"ALL", kAll},
                                       {"nonsense", kAll},
                                       {"", kAll}}) {
    EXPECT_EQ(AllowedInstructionSet(value, nullptr), allowed) << value;
    EXPECT_EQ(AllowedInstructionSet(nullptr, value), allowed) << value;
    EXPECT_EQ(AllowedInstructionSet("", value), allowed) << value;
  }
  EXPECT_EQ(AllowedInstructionSet("ALL", "SSE41"), kAll) << "the first one counts";
  EXPECT_EQ(AllowedInstructionSet("AVX2", "SSE41"), kAvx2);
}

TEST(KernelsTest, AttendToTheNeighboursOfAPatch) {
  const int64_t height = 9, width = 11, channels = 12, heads = 2, depth = 6, patch = 3;
  const Floats query = Random(height * width * channels, 1), value = Random(height * width * channels, 2);
  Floats got(query.size());
  AttentionMaps<float> maps;
  maps.height = height, maps.width = width, maps.channels = channels, maps.heads = heads, maps.patch = patch;
  maps.query = query.data(), maps.value = value.data(), maps.out = got.data();
  Floats scratch(static_cast<size_t>(maps.scratch_floats()), NAN);
  AttendItems(maps, scratch.data(), 0, heads * maps.patch_rows());
  std::vector<double> want(query.size());
  for (int64_t q = 0; q < height * width; ++q) {
    for (int64_t h = 0; h < heads; ++h) {
      double sum = 0;
      std::vector<double> mix(depth);
      for (int64_t k = 0; k < height * width; ++k) {
        if (std::abs(q / width / patch - k / width / patch) > 1) continue;
        if (std::abs(q % width / patch - k % width / patch) > 1) continue;
        double score = 0;
        for (int64_t d = 0; d < depth; ++d) {
          score += At(query, q * channels + h * depth + d) * At(value, k * channels + h * depth + d);
        }
        const double weight = std::exp(score / std::sqrt(double(depth)));
        sum += weight;
        for (int64_t d = 0; d < depth; ++d) mix[size_t(d)] += weight * At(value, k * channels + h * depth + d);
      }
      for (int64_t d = 0; d < depth; ++d) want[size_t(q * channels + h * depth + d)] = mix[size_t(d)] / sum;
    }
  }
  ExpectNear(got, want, 2e-6);
}

// Of 3x3 and, without a line above and below, 1x3; pixel by pixel (5 channels) and by Winograd's terms, of lines too
// with 33 channels.
void ExpectConvolves(ConvolutionMaps m) {
  const int64_t taps = m.kernel_height * m.kernel_width;
  const Floats x = Random(m.images * m.height * m.width * m.channels, 3);
  const Floats weights = Random(m.out_channels * taps * m.channels, 4), bias = Random(m.out_channels, 5);
  Floats packed(static_cast<size_t>(m.packed_floats())), scratch(static_cast<size_t>(m.scratch_floats()), NAN);
  Floats got(static_cast<size_t>(m.rows() * m.out_width * m.out_channels));
  m.x = x.data(), m.weights = weights.data(), m.bias = bias.data(), m.packed = packed.data(), m.y = got.data();
  PackWeights(m);
  ConvolveParts(m, scratch.data(), 0, m.parts());
  std::vector<double> want;
  for (int64_t pixel = 0; pixel < m.rows() * m.out_width; ++pixel) {
    const int64_t image = pixel / m.out_width / m.out_height;
    const int64_t top = pixel / m.out_width % m.out_height * m.stride - m.kernel_height / 2;
    const int64_t left = pixel % m.out_width * m.stride - 1;
    for (int64_t o = 0; o < m.out_channels; ++o) {
      double sum = At(bias, o);
      for (int64_t k = 0; k < taps; ++k) {
        const int64_t v = top + k / 3, u = left + k % 3;
        if (v < 0 || v >= m.height || u < 0 || u >= m.width) continue;
        for (int64_t c = 0; c < m.channels; ++c) {
          sum += At(x, ((image * m.height + v) * m.width + u) * m.channels + c) *
                 At(weights, (o * taps + k) * m.channels + c);
        }
      }
      want.push_back(sum);
    }
  }
  ExpectNear(got, want, 3e-5);  // of sums of up to 300 products, which come to 60
}

TEST(KernelsTest, Convolve) {
  ConvolutionMaps m;
  m.images = 2, m.height = 10, m.width = 15, m.channels = 5;
  m.out_height = 5, m.out_width = 8, m.out_channels = 26, m.kernel_height = 3, m.kernel_width = 3, m.stride = 2;
  ExpectConvolves(m);
  m.height = m.out_height = 7, m.width = m.out_width = 9, m.stride = 1;
  ExpectConvolves(m);
  m.channels = 17;
  ExpectConvolves(m);
  m.channels = 33;
  ExpectConvolves(m);
  m.kernel_height = 1;
  ExpectConvolves(m);
}

TEST(KernelsTest, CorrelateAroundAPosition) {
  const int64_t height = 12, width = 14, channels = 21, templates = 3, rows = 4, side = 7;
  const Floats map = Random(height * width * channels, 6), features = Random(rows * templates * channels, 7);
  const Floats xy = {6.25f, 5.5f, 0.5f, 0.75f, 12.5f, 11.25f, -30.0f, 4.0f};
  Floats got(static_cast<size_t>(rows * templates * side * side));
  const MapView view = {const_cast<float*>(map.data()), height, width};
  const std::vector<int64_t> window_of_row(rows, 0);
  CorrelationRows r;
  r.maps = {&view, window_of_row.data(), rows, 1, 1, channels};
  r.radius = 3, r.templates = templates, r.features = features.data(), r.xy = xy.data(), r.out = got.data();
  CorrelateItems(r, 0.0f, 0, rows);
  std::vector<double> want;
  for (int64_t row = 0; row < rows * templates; ++row) {
    for (int64_t offset = 0; offset < side * side; ++offset) {
      const double x = At(xy, row / templates * 2) + double(offset / side - 3);
      const double y = At(xy, row / templates * 2 + 1) + double(offset % side - 3);
      double sum = 0;
      for (int64_t corner = 0; corner < 4; ++corner) {
        const double u = std::floor(x) + double(corner % 2), v = std::floor(y) + double(corner / 2);
        if (u < 0 || v < 0 || u >= double(width) || v >= double(height)) continue;
        const double share = (1 - std::abs(x - u)) * (1 - std::abs(y - v));
        for (int64_t c = 0; c < channels; ++c) {
          sum += share * At(features, row * channels + c) * At(map, (int64_t(v) * width + int64_t(u)) * channels + c);
        }
      }
      want.push_back(sum / std::sqrt(double(channels)));
    }
  }
  ExpectNear(got, want, 5e-6);
}

TEST(KernelsTest, NormAMapAndAddToIt) {
  const int64_t pixels = 700, channels = 20;
  const Floats x = Random(pixels * channels, 8), identity = Random(pixels * channels, 9);
  Floats got(x.size()), moments(2 * channels);
  Floats partial(static_cast<size_t>(NormBlocks(pixels) * 2 * channels));
  NormMaps<float> m;
  m.pixels = pixels, m.channels = channels, m.tail = NormTail::kReluAddRelu, m.x = x.data();
  m.identity = identity.data(), m.y = got.data(), m.moments = moments.data(), m.partial = partial.data();
  NormBlockMoments(m, 0, NormBlocks(pixels));
  NormJoinMoments(m.partial, {pixels, kNormBlock}, channels, m.moments);
  NormApply(m, 0, NormBlocks(pixels));
  std::vector<double> want(x.size());
  for (int64_t c = 0; c < channels; ++c) {
    double mean = 0, squares = 0;
    for (int64_t p = 0; p < pixels; ++p) mean += At(x, p * channels + c) / double(pixels);
    for (int64_t p = 0; p < pixels; ++p) squares += std::pow(At(x, p * channels + c) - mean, 2) / double(pixels);
    for (int64_t i = c; i < pixels * channels; i += channels) {
      const double normed = std::max(0.0, (At(x, i) - mean) / std::sqrt(squares + 1e-5));
      want[size_t(i)] = std::max(0.0, normed + At(identity, i));
    }
  }
  ExpectNear(got, want, 5e-6);
}

TEST(KernelsTest, ResizeCornersOnCorners) {
  const std::vector<ResizePlace> rows = ResizePlaces(3, 2), columns = ResizePlaces(5, 3);
  const Floats map = {0, 1, 2, 10, 11, 12};  // [2, 3, 1]
  Floats got(15);
  ResizedMaps<float> m;
  m.channels = 1, m.height = 2, m.width = 3, m.out_height = 3, m.out_width = 5;
  m.rows = rows.data(), m.columns = columns.data(), m.map = map.data(), m.out = got.data(), m.out_step = 1;
  ResizeRows(m, 0, 3);
  ExpectNear(got, {0, 0.5, 1, 1.5, 2, 5, 5.5, 6, 6.5, 7, 10, 10.5, 11, 11.5, 12}, 1e-6);
}

// In both element types: bfloat16 is rounded once, as a whole register and one by one.
TEST(KernelsTest, GeluAndNormOfTokens) {
  const int64_t tokens = 3, channels = 37;
  Floats values = Random(tokens * channels, 10);
  for (float& value : values) value *= 6;
  std::vector<Bf16> halves = ToHalf(values);
  GeluValues(values.data(), 0, tokens * channels);
  std::vector<double> want;
  for (const float value : Random(tokens * channels, 10)) {
    want.push_back(3 * double(value) * std::erfc(-6 * double(value) / std::sqrt(2.0)));
  }
  ExpectNear(values, want, 6e-7);
  GeluValues(halves.data(), 0, tokens * channels);
  for (size_t i = 0; i < halves.size(); ++i) EXPECT_NEAR(ToFloat(halves[i]), want[i], 0.03 + 0.008 * std::abs(want[i]));
  NormedTokens<float> n;
  const Floats weight(channels, 2.0f), bias(channels, 1.0f);
  n.channels = channels, n.epsilon = 1e-5f, n.weight = weight.data(), n.bias = bias.data();
  n.x = values.data(), n.y = values.data();
  NormTokens(n, 0, tokens);
  for (int64_t t = 0; t < tokens; ++t) {
    double mean = 0, square = 0;
    for (int64_t c = 0; c < channels; ++c) mean += At(values, t * channels + c) / double(channels);
    for (int64_t c = 0; c < channels; ++c) square += std::pow(At(values, t * channels + c) - 1, 2) / double(channels);
    EXPECT_NEAR(mean, 1, 1e-5);
    EXPECT_NEAR(square, 4, 1e-3);
  }
}

}  // namespace
}  // namespace holdfast
