// SPDX-License-Identifier: Apache-2.0
#include "model/ops/feature_pyramid.h"

#include <torch/types.h>

#include "model/ops/feature_views.h"
#include "model/ops/shape_check.h"

namespace holdfast {
namespace {

// maps [F, C, H, W] channels-last -> [F, C, H/2, W/2] channels-last; a side of one pixel leaves an empty level.
torch::Tensor Halve(const torch::Tensor& maps) {
  const int64_t height = maps.size(2) / 2;
  const int64_t width = maps.size(3) / 2;
  if (height > 0 && width > 0) return torch::avg_pool2d(maps, 2).contiguous(torch::MemoryFormat::ChannelsLast);
  return torch::empty({maps.size(0), maps.size(1), height, width}, maps.options());
}

// [F, C, H_l, W_l] channels-last, level 0 first.
std::vector<torch::Tensor> Levels(const torch::Tensor& maps, int64_t levels) {
  CheckFloating("maps", maps, {-1, -1, -1, -1});
  std::vector<torch::Tensor> result = {maps.contiguous(torch::MemoryFormat::ChannelsLast)};
  while (static_cast<int64_t>(result.size()) < levels) result.push_back(Halve(result.back()));
  return result;
}

// The levels of 'window' as slices of its cells, frame by frame.
void AppendMaps(const PyramidCells& window, std::vector<MapView>& maps) {
  const int64_t channels = window.channels();
  const int64_t frame_bytes = window.cells.size(1) * channels * static_cast<int64_t>(window.cells.element_size());
  for (int64_t t = 0; t < window.frames(); ++t) {
    char* data = static_cast<char*>(window.cells.data_ptr()) + t * frame_bytes;
    for (const auto& [height, width] : window.sizes) {
      maps.push_back({data, height, width});
      data += height * width * channels * static_cast<int64_t>(window.cells.element_size());
    }
  }
}

}  // namespace

int64_t FeaturePyramid::bytes() const {
  int64_t total = 0;
  for (const auto& level : levels) total += static_cast<int64_t>(level.nbytes());
  return total;
}

std::vector<FeaturePyramid> BuildPyramids(const torch::Tensor& maps, int64_t levels) {
  std::vector<FeaturePyramid> frames(static_cast<size_t>(maps.size(0)));
  const bool several = frames.size() > 1;  // a frame must not keep its whole batch alive
  for (const auto& level : Levels(maps, levels)) {
    const torch::Tensor rows = level.permute({0, 2, 3, 1});
    for (size_t f = 0; f < frames.size(); ++f) {
      const torch::Tensor map = rows[static_cast<int64_t>(f)];
      frames[f].levels.push_back(several ? map.clone(torch::MemoryFormat::Contiguous) : map.contiguous());
    }
  }
  return frames;
}

FeaturePyramid BuildPyramid(const torch::Tensor& map, int64_t levels) {
  return BuildPyramids(map.unsqueeze(0), levels).front();
}

PyramidCells BuildCells(const torch::Tensor& maps, int64_t levels) {
  PyramidCells result;
  std::vector<torch::Tensor> parts;
  for (const auto& level : Levels(maps, levels)) {
    result.sizes.emplace_back(level.size(2), level.size(3));
    parts.push_back(level.permute({0, 2, 3, 1}).flatten(1, 2));
  }
  result.cells = torch::cat(parts, 1);
  return result;
}

PyramidCells JoinPyramids(const std::vector<FeaturePyramid>& frames) {
  PyramidCells result;
  for (const auto& level : frames.front().levels) result.sizes.emplace_back(level.size(0), level.size(1));
  std::vector<torch::Tensor> joined;
  for (const auto& frame : frames) {
    std::vector<torch::Tensor> parts;
    for (const auto& level : frame.levels) parts.push_back(level.flatten(0, 1));
    joined.push_back(torch::cat(parts, 0));
  }
  result.cells = torch::stack(joined);
  return result;
}

void FeatureViews::Add(const std::vector<FeaturePyramid>& window, int64_t rows) {
  const int64_t index = windows++;
  frames = static_cast<int64_t>(window.size());
  levels = static_cast<int64_t>(window.front().levels.size());
  channels = window.front().levels.front().size(2);
  dtype = window.front().levels.front().scalar_type();
  for (const auto& frame : window) {
    for (const auto& level : frame.levels) maps.push_back({level.data_ptr(), level.size(0), level.size(1)});
  }
  window_of_row.insert(window_of_row.end(), static_cast<size_t>(rows), index);
}

void FeatureViews::Add(const PyramidCells& window, int64_t rows) {
  const int64_t index = windows++;
  frames = window.frames();
  levels = static_cast<int64_t>(window.sizes.size());
  channels = window.channels();
  dtype = window.cells.scalar_type();
  AppendMaps(window, maps);
  window_of_row.insert(window_of_row.end(), static_cast<size_t>(rows), index);
}

RowMaps FeatureViews::row_maps() const { return {maps.data(), window_of_row.data(), rows(), frames, levels, channels}; }

}  // namespace holdfast
