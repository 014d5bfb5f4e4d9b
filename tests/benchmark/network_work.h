// SPDX-License-Identifier: Apache-2.0
// How much the network has to do, from the shape of its layers alone, whatever carries them out: so that figures of
// different implementations compare.
//
// Operations: convolutions, linear layers, products of correlation and of attention, a multiplication with its addition
// as two. Not counted are norms, activations, softmax, resizing and interpolation.
// Bytes: what a stage must at least read and write once, as if all between its layers stayed in the caches: inputs,
// weights and results.
#pragma once

#include <cstdint>

#include "model/options.h"

namespace holdfast {

constexpr int64_t kTemplates = 3;  // of a point at a frame, from the second iteration on

struct Work {
  double operations = 0;
  double bytes = 0;
};

inline Work operator+(Work a, Work b) { return {a.operations + b.operations, a.bytes + b.bytes}; }
inline Work operator*(double times, Work work) { return {times * work.operations, times * work.bytes}; }

// A convolution of a map of 'pixels' result pixels; 'taps' is the number of the kernel's places.
struct ConvolutionShape {
  int64_t in_channels = 0;
  int64_t out_channels = 0;
  int64_t taps = 1;
  int64_t pixels = 0;
};
double Operations(const ConvolutionShape& shape);

// What a network is measured at. Stages take what they need of it.
struct WorkShape {
  ModelOptions options;
  int64_t height = 0;  // of pictures, pixels; multiples of 8
  int64_t width = 0;
  int64_t points = 0;         // rows of a window
  int64_t element_bytes = 4;  // of weights and maps
};

Work EncoderWork(const WorkShape& shape);      // a picture
Work AttentionWork(const WorkShape& shape);    // a picture; nothing without contextual attention
Work PyramidWork(const WorkShape& shape);      // a picture
Work CorrelationWork(const WorkShape& shape);  // an iteration with three templates
Work UpdateWork(const WorkShape& shape);       // an iteration
// A window whose pictures are all new. The first of the iterations has one template, the others three.
Work WindowWork(const WorkShape& shape, int64_t iterations);

}  // namespace holdfast
