// SPDX-License-Identifier: Apache-2.0
#include "tests/benchmark/network_work.h"

#include <algorithm>

namespace holdfast {
namespace {

constexpr int64_t kFloatBytes = 4;

// Layers, one after the other.
class Layers {
 public:
  explicit Layers(int64_t element_bytes) : element_bytes_(element_bytes) {}
  void Add(const ConvolutionShape& shape) {
    work_.operations += Operations(shape);
    work_.bytes += static_cast<double>(element_bytes_ * shape.in_channels * shape.out_channels * shape.taps);
  }
  // The work of all of them, which read and write so many values of maps.
  Work Total(int64_t values) const { return work_ + Work{0, static_cast<double>(element_bytes_ * values)}; }

 private:
  const int64_t element_bytes_;
  Work work_;
};

int64_t MapHeight(const WorkShape& shape) { return shape.height / shape.options.stride; }
int64_t MapWidth(const WorkShape& shape) { return shape.width / shape.options.stride; }
int64_t MapPixels(const WorkShape& shape) { return MapHeight(shape) * MapWidth(shape); }
int64_t MapValues(const WorkShape& shape) { return MapPixels(shape) * shape.options.feature_channels; }

// Tokens that the tokens of all patches look at along one side: those of a patch times those of it and its neighbours.
int64_t SeenAlong(int64_t side, int64_t patch) {
  int64_t seen = 0;
  for (int64_t begin = 0; begin < side; begin += patch) {
    const int64_t own = std::min(side, begin + patch) - begin;
    seen += own * (std::min(side, begin + 2 * patch) - std::max<int64_t>(0, begin - patch));
  }
  return seen;
}

Work CorrelationWith(const WorkShape& shape, int64_t templates) {
  const ModelOptions& options = shape.options;
  const int64_t side = 2 * options.correlation_radius + 2;
  const int64_t items = shape.points * options.window;
  const int64_t channels = options.feature_channels;
  int64_t cells = 0;  // that are looked at in one frame: all of a small level's
  for (int64_t l = 0; l < options.correlation_levels; ++l) {
    cells += std::min((MapHeight(shape) >> l) * (MapWidth(shape) >> l), shape.points * side * side);
  }
  const int64_t values = items * templates * (channels + options.correlation_levels * options.CorrelationOffsets());
  return {2.0 * static_cast<double>(items * templates * options.correlation_levels * side * side * channels),
          static_cast<double>(kFloatBytes * values + shape.element_bytes * options.window * cells * channels)};
}

}  // namespace

double Operations(const ConvolutionShape& shape) {
  return 2.0 * static_cast<double>(shape.in_channels * shape.out_channels * shape.taps) *
         static_cast<double>(shape.pixels);
}

Work EncoderWork(const WorkShape& shape) {
  const ModelOptions& options = shape.options;
  Layers layers(shape.element_bytes);
  constexpr int64_t kSquare = 9;  // pixels of most kernels
  int64_t channels = options.encoder_channels[0];
  int64_t pixels = shape.height / 2 * (shape.width / 2);
  int64_t stacked = 0;
  layers.Add({3, channels, int64_t{7} * 7, pixels});
  for (size_t i = 0; i < options.encoder_channels.size(); ++i) {
    const int64_t out = options.encoder_channels[i];
    if (i > 0) {
      pixels = (shape.height >> (i + 1)) * (shape.width >> (i + 1));
      layers.Add({channels, out, 1, pixels});
    }
    layers.Add({channels, out, kSquare, pixels});
    for (int later = 0; later < 3; ++later) layers.Add({out, out, kSquare, pixels});
    channels = out;
    stacked += out;
  }
  layers.Add({stacked, options.encoder_mid, kSquare, MapPixels(shape)});
  layers.Add({options.encoder_mid, options.feature_channels, 1, MapPixels(shape)});
  return layers.Total(3 * shape.height * shape.width + MapValues(shape));
}

Work AttentionWork(const WorkShape& shape) {
  const ModelOptions& options = shape.options;
  if (options.context_blocks == 0) return {};
  const int64_t channels = options.feature_channels;
  const int64_t seen =
      SeenAlong(MapHeight(shape), options.context_patch) * SeenAlong(MapWidth(shape), options.context_patch);
  Layers layers(shape.element_bytes);
  for (int64_t block = 0; block < options.context_blocks; ++block) {
    layers.Add({channels, (3 + 2 * options.context_mlp_ratio) * channels, 1, MapPixels(shape)});
  }
  const Work products{2.0 * 2.0 * static_cast<double>(options.context_blocks * seen * channels), 0};
  return layers.Total(2 * MapValues(shape)) + products;
}

Work PyramidWork(const WorkShape& shape) {
  const ModelOptions& options = shape.options;
  int64_t cells = 0;  // of the levels that are made
  for (int64_t l = 1; l < options.correlation_levels; ++l) {
    cells += (MapHeight(shape) >> l) * (MapWidth(shape) >> l);
  }
  return {0, static_cast<double>(shape.element_bytes * (MapValues(shape) + cells * options.feature_channels))};
}

Work CorrelationWork(const WorkShape& shape) { return CorrelationWith(shape, kTemplates); }

Work UpdateWork(const WorkShape& shape) {
  constexpr int kStages = 4;
  const ModelOptions& options = shape.options;
  const int64_t items = shape.points * options.window;
  const int64_t outputs = options.visibility_head ? 3 : 2;
  Layers layers(shape.element_bytes);
  int64_t channels = options.update_base;
  layers.Add({options.CorrelationFeatures() + options.feature_channels + 2, channels, 3, items});
  for (int stage = 0; stage < kStages; ++stage) {
    const int64_t out = options.update_base << stage;
    layers.Add({channels, out, 3, items});
    for (int later = 0; later < 3; ++later) layers.Add({out, out, 3, items});
    channels = out;
  }
  layers.Add({channels, outputs, 1, items});
  const int64_t values = items * (options.CorrelationFeatures() + 2 + outputs);
  return layers.Total(0) + Work{0, static_cast<double>(kFloatBytes * values)};
}

Work WindowWork(const WorkShape& shape, int64_t iterations) {
  const auto frames = static_cast<double>(shape.options.window);
  const auto later = static_cast<double>(iterations - 1);
  return frames * (EncoderWork(shape) + AttentionWork(shape) + PyramidWork(shape)) + CorrelationWith(shape, 1) +
         later * CorrelationWork(shape) + (later + 1) * UpdateWork(shape);
}

}  // namespace holdfast
