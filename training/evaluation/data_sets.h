// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "api/types.h"
#include "training/data/dataset.h"
#include "training/data/synthetic/synthetic_options.h"

namespace holdfast {

struct EvaluationDataOptions {
  std::string format = "synthetic";  // see EvaluationFormats
  std::string dir;                   // of the data; unused by synthetic
  std::string split = "test";        // of pointodyssey
  std::string pictures;              // of synthetic, as in SyntheticOptions
  ImageSize size = {320, 256};       // of synthetic clips
  ImageSize crohd_size;  // crohd is scaled to it when read, as 1000 frames of full size take 6 GB; empty: not
  int64_t frames = 0;    // of a clip at most; 0: whole sequences, 24 for synthetic
  int64_t points = 0;    // of a clip at most; 0: all of them, 64 for synthetic
  size_t count = 0;      // sequences at most; 0: all of them, 20 for synthetic
  double alike_share = SyntheticOptions().alike_share;  // of synthetic, as in SyntheticOptions
  uint64_t seed = 1000;                                 // of synthetic clips; a training's clips have 0 by default
};

// "neutral", "pointodyssey", "tapvid", "crohd", "synthetic"
std::vector<std::string> EvaluationFormats();

// Whole sequences with their truth, nothing augmented. INVALID_ARGUMENT for an unknown format, NOT_FOUND for a
// directory without sequences of that format.
absl::StatusOr<std::unique_ptr<Dataset>> OpenEvaluationData(const EvaluationDataOptions& options);

}  // namespace holdfast
