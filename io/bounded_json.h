// SPDX-License-Identifier: Apache-2.0
// JSON from files that nobody vouches for.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

struct JsonLimits {
  size_t max_bytes = size_t{64} << 10;
  size_t max_depth = 4;  // objects and arrays within one another
};

// INVALID_ARGUMENT: over a limit (found before any value is built), not JSON, or an object with the same key twice.
absl::StatusOr<nlohmann::json> ParseBoundedJson(absl::string_view text, const JsonLimits& limits);

}  // namespace holdfast
