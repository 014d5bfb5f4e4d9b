// SPDX-License-Identifier: Apache-2.0
// The shape of a network, as data. A checkpoint carries one; presets are named rows of them.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

struct ModelOptions {
  std::array<int64_t, 4> encoder_channels = {64, 96, 128, 128};  // of the four residual layers; the stem has the first
  int64_t encoder_mid = 256;                                     // channels between the concatenation and the output
  int64_t feature_channels = 128;  // C; at least 8, a multiple of 4 (sine/cosine embedding) and of context_heads
  int64_t stride = 8;              // image pixels a feature pixel; only 8 exists
  int64_t context_blocks = 6;      // transformer blocks of the contextual attention; 0: none
  int64_t context_heads = 8;
  int64_t context_mlp_ratio = 4;
  int64_t context_patch = 7;  // M: side of a patch, feature pixels
  int64_t correlation_levels = 4;
  int64_t correlation_radius = 3;  // R: (2R+1)^2 offsets a level
  int64_t update_base = 128;       // channels of the update block's first stage
  bool visibility_head = false;    // one more output a frame: a visibility logit
  int64_t window = 24;             // S, frames

  // (2R+1)^2
  int64_t CorrelationOffsets() const { return (2 * correlation_radius + 1) * (2 * correlation_radius + 1); }
  // 3 templates x levels x offsets
  int64_t CorrelationFeatures() const { return 3 * correlation_levels * CorrelationOffsets(); }

  // Elements of all parameters of the network these options describe.
  int64_t ParameterCount() const;

  // Bounds every field and the parameter count, so that a hostile checkpoint cannot ask for more memory than a real
  // network takes.
  absl::Status Validate() const;

  friend bool operator==(const ModelOptions& a, const ModelOptions& b);
};

// The JSON object of a checkpoint's "holdfast.model". FromJson wants exactly these keys: unknown
// or missing keys, wrong types and values outside Validate() are INVALID_ARGUMENT naming the key.
std::string ModelOptionsToJson(const ModelOptions& options);
absl::StatusOr<ModelOptions> ModelOptionsFromJson(absl::string_view json);

}  // namespace holdfast
