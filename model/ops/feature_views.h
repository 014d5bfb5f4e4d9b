// SPDX-License-Identifier: Apache-2.0
// What the rows of a batch look at: for every row and frame of its window, the levels of that frame's pyramid. The
// frames of a window are separate tensors while serving and slices of one tensor in training; the kernels see pointers.
#pragma once

#include <torch/types.h>

#include <utility>
#include <vector>

#include "model/kernels/map_view.h"
#include "model/ops/feature_pyramid.h"

namespace holdfast {

// All levels of S frames in one tensor, so that one gradient flows back through it.
struct PyramidCells {
  torch::Tensor cells;                             // [S, sum of H_l * W_l, C], level after level, each row-major
  std::vector<std::pair<int64_t, int64_t>> sizes;  // (H_l, W_l), level 0 first

  int64_t frames() const { return cells.size(0); }
  int64_t channels() const { return cells.size(2); }
};

// maps [S, C, H8, W8] of any floating dtype and memory format; differentiable.
PyramidCells BuildCells(const torch::Tensor& maps, int64_t levels);
// The frames of one window, joined; copies.
PyramidCells JoinPyramids(const std::vector<FeaturePyramid>& frames);

// CPU only. Borrows: the tensors must outlive it.
struct FeatureViews {
  std::vector<MapView> maps;           // [windows, S, L]
  std::vector<int64_t> window_of_row;  // [N]
  int64_t windows = 0;
  int64_t frames = 0;    // S
  int64_t levels = 0;    // L
  int64_t channels = 0;  // C
  torch::ScalarType dtype = torch::kFloat32;

  // Appends a window and its 'rows'. REQUIRES: same S, L, C and dtype as the windows before.
  void Add(const std::vector<FeaturePyramid>& window, int64_t rows);
  void Add(const PyramidCells& window, int64_t rows);
  int64_t rows() const { return static_cast<int64_t>(window_of_row.size()); }
  RowMaps row_maps() const;
};

}  // namespace holdfast
