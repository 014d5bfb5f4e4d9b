// SPDX-License-Identifier: Apache-2.0
// Features at sub-pixel positions: bilinear, positions clamped to the map.
#pragma once

#include <torch/types.h>

#include "model/ops/feature_views.h"

namespace holdfast {

// xy [N, 2] float32 feature pixels -> [N, C] float32: the template of a query on 'frame'. Any device; no gradient.
torch::Tensor SampleFeatures(const FeaturePyramid& frame, const torch::Tensor& xy);

// xy [N, S, 2] float32 feature pixels, row n at frame t of its window -> [N, S, C] float32.
torch::Tensor SampleRows(const FeatureViews& views, const torch::Tensor& xy);
// The same for one window, on any device, with a gradient for the maps (none for the positions).
torch::Tensor SampleRows(const PyramidCells& window, const torch::Tensor& xy);
// The same in ATen operations only: the way of devices without a kernel.
torch::Tensor SampleRowsPlain(const PyramidCells& window, const torch::Tensor& xy);

}  // namespace holdfast
