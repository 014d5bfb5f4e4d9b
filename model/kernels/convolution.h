// SPDX-License-Identifier: Apache-2.0
// Plain loops behind convolution.cc: the convolution of float32 maps as products of matrices. A part of the result
// is computed the same way whatever there is besides.
#pragma once

#include <cstdint>

namespace holdfast {

// Padding is half of the kernel, with zeros.
struct ConvolutionMaps {
  int64_t images = 0;
  int64_t height = 0, width = 0, channels = 0;  // of x
  int64_t out_height = 0, out_width = 0, out_channels = 0;
  int64_t kernel_height = 0, kernel_width = 0;
  int64_t stride = 1;
  const float* x = nullptr;        // [images, height, width, channels]
  const float* weights = nullptr;  // [out_channels, kernel_height, kernel_width, channels]
  const float* bias = nullptr;     // [out_channels]; may be null
  // [images, 2, channels], mean and 1 / deviation, or null: x is normed with them, and cut off at zero, as it is read.
  const float* moments = nullptr;
  float* packed = nullptr;  // packed_floats(): weights and bias in the order in which they are read
  float* y = nullptr;       // [images, out_height, out_width, out_channels]
  // [images, out_height, 2, out_channels] or null: mean and sum of squares of each row of y (see instance_norm.h).
  float* partial = nullptr;

  int64_t rows() const { return images * out_height; }
  // The work comes in parts: rows of the result, or pairs of rows of a map.
  int64_t parts() const;
  int64_t packed_floats() const;
  // Parts that are computed together.
  int64_t group_parts() const;
  // Floats of scratch memory that one thread needs.
  int64_t scratch_floats() const;
};

// Fills 'packed', before anything else.
void PackWeights(const ConvolutionMaps& maps);
// Parts [begin, end).
void ConvolveParts(const ConvolutionMaps& maps, float* scratch, int64_t begin, int64_t end);

}  // namespace holdfast
