// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/types/span.h"
#include "api/clock.h"
#include "model/point_model.h"
#include "training/clip_source.h"
#include "training/distributed.h"
#include "training/loss/clip_step.h"
#include "training/recipe.h"
#include "training/report/training_report.h"
#include "training/working_network.h"

namespace holdfast {

// Draws this process's batches, of clips as the training's phase wants them, and adds their gradients to the network's.
// On the processor the clips of a batch run beside each other, each on a thread and a copy of the network of its own,
// where they keep more than half of the threads busy (model/shares.h); their gradients are added in the clips' order,
// so the sum does not depend on which one was done first. What it borrows must outlive it. Not thread-safe.
class BatchGradients {
 public:
  struct Parts {
    PointModel model = nullptr;                 // float32; gets the gradients
    torch::ScalarType dtype = torch::kFloat32;  // that clips are run in
    ClipSource* clips = nullptr;
    const ProcessGroup* group = nullptr;
    const Clock* clock = nullptr;
  };

  BatchGradients(const Recipe& recipe, uint64_t seed, torch::Device device, const Parts& parts);

  // Adds the gradients of this process's part of the batch that begins with draw 'first_draw' of the data, at
  // 'progress' of the training, and to 'times' and 'sum' what its clips took and lost. Batches must be asked for in
  // order.
  absl::Status Add(int64_t first_draw, double progress, StepTimes& times, LossValues& sum);
  // Takes over the network's weights, which have changed.
  void Refresh();
  // Damaged samples of this process so far, and what the last of them said.
  int64_t skipped_samples() const;
  std::string last_skip() const;

 private:
  absl::Status OpenLoader(int64_t first_draw, double progress);
  // As many clips as there are networks, beside each other; 'first_draw' is the number of the first one's chance.
  void AddClips(absl::Span<const ClipTensors> clips, int64_t first_draw, const ClipStepOptions& options,
                StepTimes& times, LossValues& sum);

  const Recipe& recipe_;
  const uint64_t seed_;
  const torch::Device device_;
  const Parts parts_;
  std::vector<WorkingNetwork> networks_;  // of clips that run beside each other
  std::unique_ptr<Loader> loader_;
  const Phase* phase_ = nullptr;  // of the loader
  int64_t skipped_before_ = 0;    // by loaders closed before
  std::string last_skip_before_;  // of theirs
};

}  // namespace holdfast
