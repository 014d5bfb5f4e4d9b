// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <vector>

namespace holdfast {

// One frame's features at L scales: level l is [H8 / 2^l, W8 / 2^l, C] contiguous, each the 2x2 average of the one
// before (rounded down, as the published code pools).
struct FeaturePyramid {
  std::vector<torch::Tensor> levels;
  int64_t bytes() const;
};

// map [C, H8, W8] (any memory format, any floating dtype) -> pyramid in the same dtype.
FeaturePyramid BuildPyramid(const torch::Tensor& map, int64_t levels);
// Batched: maps [F, C, H8, W8] -> F pyramids.
std::vector<FeaturePyramid> BuildPyramids(const torch::Tensor& maps, int64_t levels);

}  // namespace holdfast
