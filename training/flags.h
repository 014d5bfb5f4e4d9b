// SPDX-License-Identifier: Apache-2.0
// The flags of holdfast-train and what they ask for.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "model/options.h"
#include "training/distributed.h"
#include "training/trainer.h"
#include "training/training_data.h"

namespace holdfast {

struct TrainRequest {
  ModelOptions network;
  TrainerOptions trainer;  // 'device' as well
  TrainingDataOptions data;
  TrainingDataOptions validation_data;
  int64_t validation_clips = 16;      // 0: no validation
  int64_t validation_iterations = 4;  // refinement iterations, whatever the recipe trains with: those of serving
  std::string init;                   // checkpoint to start from, not to go on; empty: random weights
  std::string metrics_address;        // host:port; empty: none
  int64_t log_every = 20;             // steps between lines where there is no terminal
  int workers = 1;                    // threads that make clips: more where steps wait for data
  int threads = 0;                    // of one tensor operation; 0: all cores
  bool choose_precision = true;       // the recipe's bfloat16 only where it is fast and right
};

// From the values the flags have now, for this process of the group: it opens its own device and no other.
// INVALID_ARGUMENT names the flag.
absl::StatusOr<TrainRequest> TrainRequestFromFlags(const GroupOptions& group);

// "0.7:256x192:64:3,1:320x256:64:4": until:WIDTHxHEIGHT:points:iterations of each phase.
absl::StatusOr<std::vector<Phase>> ParsePhases(const std::string& text);

}  // namespace holdfast
