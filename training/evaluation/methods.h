// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "api/types.h"
#include "server/engine/engine.h"
#include "training/evaluation/calibration_fit.h"
#include "training/evaluation/clip_tracker.h"

namespace holdfast {

struct EvaluationMethodsOptions {
  EngineOptions engine;       // with empty weights_path the network takes no part
  bool lucas_kanade = false;  // takes part too, on frames of their own size
  bool calibrate = false;     // keep what a calibration of the network's confidence is fitted to
};

// The methods an evaluation compares: the network behind the engine that serves it, and the baseline. One thread at a
// time may use it.
class EvaluationMethods {
 public:
  // Loads the weights. INVALID_ARGUMENT when no method is asked for.
  static absl::StatusOr<std::unique_ptr<EvaluationMethods>> Create(const EvaluationMethodsOptions& options);
  virtual ~EvaluationMethods() = default;
  // The methods with the network's frames at 'processing_size'; empty: the engine's default. They must not outlive
  // this.
  virtual absl::StatusOr<std::vector<std::unique_ptr<ClipTracker>>> At(ImageSize processing_size) = 0;
  // What the network estimated so far; empty unless 'calibrate'.
  virtual const std::vector<Judged>& judged() const = 0;
};

}  // namespace holdfast
