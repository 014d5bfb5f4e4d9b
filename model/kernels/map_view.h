// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace holdfast {

// One feature map as the kernels see it: [height, width, channels] contiguous, not owned here.
struct MapView {
  void* data = nullptr;
  int64_t height = 0;
  int64_t width = 0;
};

// The maps of a batch of rows. Item (n, t) of N rows and S frames looks at the L maps
// maps[(window_of_row[n] * frames + t) * levels ...].
struct RowMaps {
  const MapView* maps = nullptr;
  const int64_t* window_of_row = nullptr;
  int64_t rows = 0;
  int64_t frames = 0;
  int64_t levels = 0;
  int64_t channels = 0;

  const MapView* At(int64_t row, int64_t frame) const { return maps + (window_of_row[row] * frames + frame) * levels; }
};

}  // namespace holdfast
