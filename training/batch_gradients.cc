// SPDX-License-Identifier: Apache-2.0
#include "training/batch_gradients.h"

#include <utility>
#include <vector>

#include "training/loss/clip_step.h"

namespace holdfast {
namespace {

void AddTimes(const StepTimes& times, StepTimes& sum) {
  sum.encode += times.encode;
  sum.refine += times.refine;
  sum.backward += times.backward;
}

void AddLoss(const LossValues& loss, LossValues& sum) {
  for (const LossColumn& column : kLossColumns) sum.*column.value += loss.*column.value;
}

}  // namespace

BatchGradients::BatchGradients(const Recipe& recipe, uint64_t seed, torch::Device device, const Parts& parts)
    : recipe_(recipe), seed_(seed), device_(device), parts_(parts), working_(parts.model, parts.dtype) {}

absl::Status BatchGradients::OpenLoader(int64_t batch, double progress) {
  const Phase* phase = &recipe_.PhaseAt(progress);
  if (phase == phase_) return absl::OkStatus();
  if (loader_ != nullptr) skipped_before_ += loader_->skipped();
  loader_.reset();
  absl::StatusOr<std::unique_ptr<Loader>> loader = parts_.clips->Open(*phase, batch);
  if (!loader.ok()) return loader.status();
  loader_ = *std::move(loader);
  phase_ = phase;
  return absl::OkStatus();
}

absl::Status BatchGradients::Add(int64_t batch, double progress, StepTimes& times, LossValues& sum) {
  if (const absl::Status status = OpenLoader(batch, progress); !status.ok()) return status;
  const SteadyTime begin = parts_.clock->SteadyNow();
  const absl::StatusOr<std::vector<Sample>> samples = loader_->Next();
  if (!samples.ok()) return samples.status();
  times.data += parts_.clock->Since(begin);
  const int64_t first_draw = (batch * parts_.group->world() + parts_.group->rank()) * recipe_.batch_size;
  const ClipStepOptions options = {recipe_.LossAt(progress),
                                   {recipe_.noisy_start, recipe_.streaming_windows, recipe_.chain_start},
                                   phase_->iterations};
  for (size_t i = 0; i < samples->size(); ++i) {
    const absl::StatusOr<ClipTensors> clip = ToTensors((*samples)[i], parts_.model->options().stride);
    if (!clip.ok()) return clip.status();
    // Another stream of chance than the data's, which is seeded by the same number.
    Rng rng(MixSeed(seed_, ~uint64_t{0}), static_cast<uint64_t>(first_draw) + i);
    const ClipStepResult result = AddClipGradient(working_.network(), clip->To(device_), options, rng, *parts_.clock);
    working_.CollectGradients();
    AddTimes(result.times, times);
    AddLoss(result.loss, sum);
  }
  return absl::OkStatus();
}

int64_t BatchGradients::skipped_samples() const {
  return skipped_before_ + (loader_ == nullptr ? 0 : loader_->skipped());
}

}  // namespace holdfast
