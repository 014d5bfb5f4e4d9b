// SPDX-License-Identifier: Apache-2.0
// The training job: steps, checkpoints, validation. Everything it works with is given to it.
#pragma once

#include <torch/types.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "model/point_model.h"
#include "training/clip_source.h"
#include "training/distributed.h"
#include "training/recipe.h"
#include "training/report/training_report.h"
#include "training/validation.h"

namespace holdfast {

struct TrainerOptions {
  Recipe recipe;
  std::string directory;  // of checkpoints and weights; every process sees the same
  uint64_t seed = 0;
  // Training ends after this time, over all runs; where the recipe has no number of steps its schedule follows the
  // time.
  absl::Duration time_budget = absl::InfiniteDuration();
  int64_t validate_every = 500;    // steps; each validation stops all processes while one of them runs it; 0: never
  int64_t checkpoint_every = 500;  // steps that a crash may cost; 0: a checkpoint at the end only
  // So many steps in a row without a finite gradient end the training: the weights are broken, or the rate too high.
  int64_t max_skipped_in_row = 25;
  torch::Device device = torch::kCPU;
  // The network runs in float32 though the recipe says bfloat16, because this machine computes that wrongly or slowly.
  // No part of the recipe: a training may go on on another machine.
  bool bfloat16_unfit = false;

  absl::Status Validate() const;
};

// Borrowed, but for the network: they must outlive the trainer.
struct TrainerParts {
  PointModel model = nullptr;  // float32, on the options' device; at its initial weights
  ClipSource* clips = nullptr;
  const Validation* validation = nullptr;  // null: none
  ProcessGroup* group = nullptr;
  TrainingObserver* observer = nullptr;  // hears of rank 0's events, and notices of its own process
  const Clock* clock = nullptr;
  const std::atomic<bool>* stop = nullptr;  // true: finish the step, write a checkpoint and return
};

enum class StopReason { kFinished, kAsked };

struct TrainingSummary {
  StopReason reason = StopReason::kFinished;
  int64_t step = 0;
  double best = -1;  // validation; below 0: none took place
};

// One thread calls. With several processes, all run the same loop in step: the step's numbers, a request to stop and
// the progress travel with the gradients, so every process takes the same decisions.
//
// Files in the directory: the checkpoints of training_checkpoint.h; best.safetensors, the averaged weights of the best
// validation (share of visible points, delta_vis); final.safetensors, the averaged weights when the training is done.
class Trainer {
 public:
  // Goes on from the directory's newest checkpoint where there is one. FAILED_PRECONDITION when that was made by
  // another recipe, seed or network.
  static absl::StatusOr<std::unique_ptr<Trainer>> Create(const TrainerOptions& options, const TrainerParts& parts);
  virtual ~Trainer() = default;

  // Until the steps are done, the time is up or a stop is asked for; a checkpoint is written in each case. No process
  // returns a summary before all have come to the end and rank 0 has written its files. Errors: ABORTED after too many
  // steps without a finite gradient (no checkpoint is written then), UNAVAILABLE when another process died or failed,
  // and those of reading and writing.
  virtual absl::StatusOr<TrainingSummary> Run() = 0;
};

}  // namespace holdfast
