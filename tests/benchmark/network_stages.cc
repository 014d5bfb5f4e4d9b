// SPDX-License-Identifier: Apache-2.0
// The network stage by stage, and a whole window.
#include <torch/types.h>

#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/contextual_attention.h"
#include "model/encoder.h"
#include "model/ops/convolution.h"
#include "model/ops/correlation.h"
#include "model/ops/feature_pyramid.h"
#include "model/ops/sampling.h"
#include "model/point_model.h"
#include "model/presets.h"
#include "model/update_block.h"
#include "tests/benchmark/bench_case.h"
#include "tests/benchmark/network_work.h"

namespace holdfast {
namespace {

constexpr int64_t kIterations = 6;  // of a window, as published

struct NetworkCase {
  std::string preset;
  NumberType precision;
  ModelOptions options;
  int threads = 1;
  ImageSize size;      // empty: the stage knows no pictures
  int64_t points = 0;  // 0: it knows no points

  CaseName Name(const char* stage) const {
    const std::string sides = size.empty() ? "-" : absl::StrCat(size.height, "x", size.width);
    return {stage, preset, precision.name, sides, points > 0 ? std::to_string(points) : "-", threads};
  }
  WorkShape Shape() const {
    const auto element = static_cast<int64_t>(torch::elementSize(precision.type));
    return {options, size.height, size.width, points, element};
  }
};

template <typename Module>
Module Ready(Module module, torch::ScalarType type) {
  module->to(type);
  module->eval();
  PackWeights(*module);
  return module;
}

// Feature maps of so many frames, as the encoder makes them.
torch::Tensor RandomMaps(const NetworkCase& c, int64_t frames) {
  const int64_t stride = c.options.stride;
  return torch::randn({frames, c.options.feature_channels, c.size.height / stride, c.size.width / stride})
      .to(c.precision.type)
      .contiguous(torch::MemoryFormat::ChannelsLast);
}

// [points, 2] on the maps.
torch::Tensor RandomPlaces(const NetworkCase& c) {
  const int64_t stride = c.options.stride;
  const torch::Tensor last = torch::tensor({c.size.width / stride - 1, c.size.height / stride - 1}, torch::kFloat32);
  return torch::rand({c.points, 2}) * last;
}

// [points, S, 2] around them, each point moving a little.
torch::Tensor RandomPaths(const NetworkCase& c) {
  return RandomPlaces(c).unsqueeze(1) + torch::randn({c.points, c.options.window, 2});
}

void RegisterEncode(const NetworkCase& c) {
  RegisterCase({c.Name("encode"), EncoderWork(c.Shape()), [c] {
                  Encoder encoder = Ready(Encoder(c.options), c.precision.type);
                  const torch::Tensor picture = torch::rand({1, c.size.height, c.size.width, 3}).to(c.precision.type);
                  return [encoder, x = picture.permute({0, 3, 1, 2})]() mutable { encoder->forward(x); };
                }});
}

void RegisterAttention(const NetworkCase& c) {
  if (c.options.context_blocks == 0) return;
  RegisterCase({c.Name("attention"), AttentionWork(c.Shape()), [c] {
                  ContextualAttention context = Ready(ContextualAttention(c.options), c.precision.type);
                  return [context, map = RandomMaps(c, 1)]() mutable { context->forward(map); };
                }});
}

void RegisterPyramid(const NetworkCase& c) {
  RegisterCase({c.Name("pyramid"), PyramidWork(c.Shape()), [c] {
                  return
                      [map = RandomMaps(c, 1), levels = c.options.correlation_levels] { BuildPyramids(map, levels); };
                }});
}

void RegisterCorrelation(const NetworkCase& c) {
  RegisterCase(
      {c.Name("correlation"), CorrelationWork(c.Shape()), [c] {
         const int64_t frames = c.options.window;
         const auto window = BuildPyramids(RandomMaps(c, frames), c.options.correlation_levels);
         const torch::Tensor templates = torch::randn({c.points, frames, kTemplates, c.options.feature_channels});
         return [=, paths = RandomPaths(c), radius = c.options.correlation_radius] {
           FeatureViews views;
           views.Add(window, paths.size(0));
           Correlate(views, templates, paths, radius);
         };
       }});
}

void RegisterUpdate(const NetworkCase& c) {
  RegisterCase(
      {c.Name("update"), UpdateWork(c.Shape()), [c] {
         UpdateBlock block = Ready(UpdateBlock(c.options), c.precision.type);
         const torch::Tensor correlation = torch::randn({c.points, c.options.window, c.options.CorrelationFeatures()});
         const torch::Tensor paths = torch::randn({c.points, c.options.window, 2});
         return [block, correlation, paths]() mutable { block->forward(correlation, paths); };
       }});
}

WindowRows MakeRows(const NetworkCase& c, const torch::Tensor& maps, const torch::Tensor& places) {
  WindowRows rows;
  rows.frames = BuildPyramids(maps, c.options.correlation_levels);
  rows.start = places.unsqueeze(1).repeat({1, c.options.window, 1});
  rows.feature = SampleFeatures(rows.frames.front(), places);
  return rows;
}

// All frames of a window encoded, and their points refined.
void RegisterWindow(const NetworkCase& c) {
  RegisterCase({c.Name("window"), WindowWork(c.Shape(), kIterations), [c] {
                  PointModel model = Ready(PointModel(c.options), c.precision.type);
                  const torch::Tensor pictures =
                      torch::randint(0, 256, {c.options.window, c.size.height, c.size.width, 3}, torch::kUInt8);
                  return [c, model, pictures, places = RandomPlaces(c)]() mutable {
                    model->Refine({MakeRows(c, model->Encode(pictures), places)}, {kIterations, false});
                  };
                }});
}

void RegisterStagesOfMaps(NetworkCase c, const BenchGrid& grid) {
  RegisterEncode(c);
  RegisterAttention(c);
  RegisterPyramid(c);
  for (const int64_t points : grid.points) {
    c.points = points;
    RegisterCorrelation(c);
    RegisterWindow(c);
  }
}

void RegisterStages(NetworkCase c, const BenchGrid& grid) {
  for (const int64_t points : grid.points) {
    c.points = points;
    RegisterUpdate(c);
  }
  c.points = 0;
  for (const ImageSize size : grid.sizes) {
    c.size = size;
    RegisterStagesOfMaps(c, grid);
  }
}

}  // namespace

void RegisterNetworkStages(const BenchGrid& grid) {
  for (const std::string& preset : grid.presets) {
    for (const NumberType& precision : grid.precisions) {
      for (const int threads : grid.threads) {
        RegisterStages({preset, precision, PresetByName(preset).value(), threads}, grid);
      }
    }
  }
}

}  // namespace holdfast
