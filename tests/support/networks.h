// SPDX-License-Identifier: Apache-2.0
// Small networks for tests.
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include "model/options.h"
#include "model/point_model.h"
#include "model/precision_check.h"
#include "model/presets.h"

namespace holdfast {

// Every part of the network at its smallest: attention, visibility head, all scales.
inline ModelOptions TinyOptions() {
  ModelOptions options;
  options.encoder_channels = {8, 12, 16, 16};
  options.encoder_mid = 24;
  options.feature_channels = 16;
  options.context_blocks = 1;
  options.context_heads = 2;
  options.context_mlp_ratio = 2;
  options.update_base = 8;
  options.visibility_head = true;
  options.window = 8;
  return options;
}

// Preset "test" with random weights, the same each time, in eval mode.
inline PointModel RandomModel() {
  torch::manual_seed(7);
  PointModel model(*PresetByName("test"));
  model->eval();
  return model;
}

// A bfloat16 network of the same options with other weights: what a faulty library looks like.
inline PointModel BrokenCopy(const PointModel& exact) {
  PointModel model = CopyInPrecision(exact, torch::kBFloat16);
  const torch::NoGradGuard no_grad;
  for (auto& parameter : model->parameters()) parameter.copy_(torch::randn(parameter.sizes()));
  return model;
}

}  // namespace holdfast
