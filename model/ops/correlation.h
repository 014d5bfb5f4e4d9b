// SPDX-License-Identifier: Apache-2.0
// Local correlation: dot products of templates with the features around a position, at every pyramid level, without
// ever building the full correlation volume. The (2R+1)^2 offsets of a level share one sub-pixel shift, so a patch of
// (2R+2)^2 dot products blended bilinearly gives them all.
#pragma once

#include <torch/types.h>

#include "model/ops/feature_views.h"

namespace holdfast {

// templates [N, S, K, C] float32, xy [N, S, 2] float32 feature pixels (level 0) -> [N, S, K, L * (2R+1)^2] float32,
// divided by sqrt(C); zero outside the map. Offset j = a * (2R+1) + b lies at x + a - R, y + b - R. No gradient.
torch::Tensor Correlate(const FeatureViews& views, const torch::Tensor& templates, const torch::Tensor& xy,
                        int64_t radius);
// The same for one window, on any device, with gradients for maps and templates (none for the positions).
torch::Tensor Correlate(const PyramidCells& window, const torch::Tensor& templates, const torch::Tensor& xy,
                        int64_t radius);
// The same in ATen operations only: the way of devices without a kernel.
torch::Tensor CorrelatePlain(const PyramidCells& window, const torch::Tensor& templates, const torch::Tensor& xy,
                             int64_t radius);

}  // namespace holdfast
