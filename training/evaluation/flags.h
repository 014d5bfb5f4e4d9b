// SPDX-License-Identifier: Apache-2.0
// The flags of holdfast-eval and what they ask for.
#pragma once

#include <map>
#include <string>

#include "absl/status/statusor.h"
#include "training/evaluation/data_sets.h"
#include "training/evaluation/methods.h"

namespace holdfast {

struct EvaluateRequest {
  EvaluationMethodsOptions methods;
  EvaluationDataOptions data;
  ImageSize processing_size;  // empty: the engine's default, or the paper's
  bool suite = false;         // the paper's data sets below data.dir instead of 'data'
  std::string json;           // empty: no file
  std::string calibrate;      // where the weights with a calibration of their confidence go; empty: none is fitted
};

// From the values the flags have now. INVALID_ARGUMENT names the flag.
absl::StatusOr<EvaluateRequest> RequestFromFlags();

// The value of every flag that is not at its default, for reports.
std::map<std::string, std::string> SettingsFromFlags();

}  // namespace holdfast
