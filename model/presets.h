// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "model/options.h"

namespace holdfast {

// Options by name: "paper", "pips2", "small", "test". NOT_FOUND lists the names there are.
absl::StatusOr<ModelOptions> PresetByName(absl::string_view name);
std::vector<std::string> PresetNames();
// The preset with these options, or "custom".
std::string PresetName(const ModelOptions& options);

}  // namespace holdfast
