// SPDX-License-Identifier: Apache-2.0
#include "model/presets.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

struct Preset {
  const char* name;
  ModelOptions options;
};

ModelOptions WithoutContext() {
  ModelOptions options;
  options.context_blocks = 0;
  return options;
}

ModelOptions Small() {
  ModelOptions options;
  options.encoder_channels = {24, 32, 48, 64};
  options.encoder_mid = 96;
  options.feature_channels = 64;
  options.context_blocks = 2;
  options.context_heads = 4;
  options.context_mlp_ratio = 2;
  options.update_base = 48;
  options.visibility_head = true;
  return options;
}

ModelOptions Test() {
  ModelOptions options;
  options.encoder_channels = {8, 8, 16, 16};
  options.encoder_mid = 16;
  options.feature_channels = 16;
  options.context_blocks = 1;
  options.context_heads = 2;
  options.context_mlp_ratio = 1;
  options.correlation_levels = 2;
  options.correlation_radius = 2;
  options.update_base = 8;
  options.visibility_head = true;
  return options;
}

std::vector<Preset> Presets() {
  return {{"paper", ModelOptions()}, {"pips2", WithoutContext()}, {"small", Small()}, {"test", Test()}};
}

}  // namespace

absl::StatusOr<ModelOptions> PresetByName(absl::string_view name) {
  for (const Preset& preset : Presets()) {
    if (name == preset.name) return preset.options;
  }
  return absl::NotFoundError(absl::StrCat("no preset '", name, "'; there are: ", absl::StrJoin(PresetNames(), ", ")));
}

std::vector<std::string> PresetNames() {
  std::vector<std::string> names;
  for (const Preset& preset : Presets()) names.emplace_back(preset.name);
  return names;
}

std::string PresetName(const ModelOptions& options) {
  for (const Preset& preset : Presets()) {
    if (options == preset.options) return preset.name;
  }
  return "custom";
}

}  // namespace holdfast
