// SPDX-License-Identifier: Apache-2.0
// Whether the network in bfloat16 says what it says in float32. Libraries below have had kernels that were wrong for
// some sizes only, so the programs ask before they rely on it, at the very size that they are about to use.
#pragma once

#include <torch/types.h>

#include <string>

#include "model/point_model.h"

namespace holdfast {

struct PrecisionDifference {
  double features = 0;   // root mean square of the difference of feature maps, relative to that of the float32 maps
  double positions = 0;  // image pixels, mean over points and frames after two iterations of a window at rest

  // Rounding explains what is below the bounds: it was measured to make features differ by 0.008 and positions by
  // 0.04 px with trained weights, by 0.03 and 1.3 px with random ones. A wrong kernel is off by the size of the maps
  // themselves. Not a number is never within.
  static constexpr double kMaxFeatures = 0.15;
  static constexpr double kMaxPositions = 4.0;
  bool within() const { return features <= kMaxFeatures && positions <= kMaxPositions; }
};

// "features differ by 0.012, positions by 0.04 px".
std::string ToString(const PrecisionDifference& difference);

// Encodes 'picture' [H, W, 3] uint8 with both networks and runs one short window on it. 'exact' is float32, 'fast' any
// dtype, both with the same options; sides are multiples of their stride. No gradients.
PrecisionDifference ComparePrecisions(PointModel exact, PointModel fast, const torch::Tensor& picture);

// The network of 'model' in 'dtype', which shares no memory with it.
PointModel CopyInPrecision(const PointModel& model, torch::ScalarType dtype);

// A picture with structure at every scale, the same each time: [height, width, 3] uint8.
torch::Tensor CheckPicture(int64_t height, int64_t width);

}  // namespace holdfast
