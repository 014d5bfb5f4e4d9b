// SPDX-License-Identifier: Apache-2.0
// Where a training stands, on disk. A checkpoint is a pair of files in one directory,
//   checkpoint-00001200.safetensors         the weights, which any program can load, and
//   checkpoint-00001200.state.safetensors   all else it takes to go on exactly,
// each written atomically and carrying the same id. The pair before stays until a new one is complete, so whatever
// kills the process, at any moment, leaves a complete pair behind.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "model/checkpoint/safetensors.h"
#include "model/point_model.h"

namespace holdfast {

struct TrainingState {
  int64_t step = 0;        // optimizer steps done
  int64_t next_draw = 0;   // of the data
  int64_t world = 0;       // processes that it was written by; 0: an earlier file, whose next_draw counts their batches
  uint64_t seed = 0;       // of all chance: what a step draws is a function of it and of the batch's number
  absl::Duration elapsed;  // of training, over all runs
  int64_t skipped_steps = 0;
  double best = -1;             // validation so far; below 0: none yet
  double validated = -1;        // the last validation
  int64_t validated_step = -1;  // and after which step that was; below 0: none yet
  std::string recipe;           // Describe() of the recipe
  std::string optimizer;        // its archive
  std::map<std::string, torch::Tensor> average;
  int64_t average_updates = 0;
};

struct TrainingCheckpoint {
  std::string path;  // of the weights
  TensorFile weights;
  TrainingState state;
  std::string skipped;  // why newer files were passed over; empty: there were none
};

// Writes the pair of state.step and removes the files of all other steps but the newest complete pair before it. A
// complete pair of this step stays as it is: a step's state follows from the seed and the recipe. On an error the
// directory still holds the complete pairs it held. 'now', of the wall clock, tells this pair's files from those of
// others of the same step.
absl::Status SaveTrainingCheckpoint(const std::string& directory, const PointModelImpl& model,
                                    const TrainingState& state, absl::Time now);

// Whether FindTrainingCheckpoint gives a pair or an error.
bool HasTrainingCheckpoint(const std::string& directory);

// The newest complete pair; nullopt when the directory has no checkpoint at all, or only the first one's weights: a
// process that was killed between the two files left nothing to go on from. DATA_LOSS when there are some, but
// none is complete and readable.
absl::StatusOr<std::optional<TrainingCheckpoint>> FindTrainingCheckpoint(const std::string& directory);

}  // namespace holdfast
