// SPDX-License-Identifier: Apache-2.0
#include "training/batch_gradients.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "model/shares.h"

namespace holdfast {
namespace {

// Times of clips that ran beside each other add up to more than the step took: each counts for its share of that.
void AddTimes(const StepTimes& times, double share, StepTimes& sum) {
  sum.encode += times.encode * share;
  sum.refine += times.refine * share;
  sum.backward += times.backward * share;
}

void AddLoss(const LossValues& loss, LossValues& sum) {
  for (const LossColumn& column : kLossColumns) sum.*column.value += loss.*column.value;
}

}  // namespace

BatchGradients::BatchGradients(const Recipe& recipe, uint64_t seed, torch::Device device, const Parts& parts)
    : recipe_(recipe), seed_(seed), device_(device), parts_(parts) {
  const int64_t beside = device.is_cpu() ? std::min<int64_t>(recipe.batch_size, at::get_num_threads()) : 1;
  for (int64_t i = 0; i < beside; ++i) networks_.emplace_back(parts.model, parts.dtype, /*copy=*/i > 0);
}

void BatchGradients::Refresh() {
  for (WorkingNetwork& network : networks_) network.Refresh();
}

absl::Status BatchGradients::OpenLoader(int64_t first_draw, double progress) {
  const Phase* phase = &recipe_.PhaseAt(progress);
  if (phase == phase_) return absl::OkStatus();
  last_skip_before_ = last_skip();
  skipped_before_ = skipped_samples();
  loader_.reset();
  absl::StatusOr<std::unique_ptr<Loader>> loader = parts_.clips->Open(*phase, first_draw);
  if (!loader.ok()) return loader.status();
  loader_ = *std::move(loader);
  phase_ = phase;
  return absl::OkStatus();
}

absl::Status BatchGradients::Add(int64_t first_draw, double progress, StepTimes& times, LossValues& sum) {
  if (const absl::Status status = OpenLoader(first_draw, progress); !status.ok()) return status;
  const SteadyTime begin = parts_.clock->SteadyNow();
  const absl::StatusOr<std::vector<Sample>> samples = loader_->Next();
  if (!samples.ok()) return samples.status();
  times.data += parts_.clock->Since(begin);
  const int64_t my_first_draw = first_draw + parts_.group->rank() * recipe_.batch_size;
  const ClipStepOptions options = {recipe_.LossAt(progress),
                                   {recipe_.noisy_start, recipe_.streaming_windows, recipe_.chain_start},
                                   phase_->iterations};
  std::vector<ClipTensors> clips;
  for (const Sample& sample : *samples) {
    absl::StatusOr<ClipTensors> clip = ToTensors(sample, parts_.model->options().stride);
    if (!clip.ok()) return clip.status();
    clips.push_back(*std::move(clip));
  }
  for (size_t i = 0; i < clips.size(); i += networks_.size()) {
    AddClips(absl::MakeConstSpan(clips).subspan(i, networks_.size()), my_first_draw + static_cast<int64_t>(i), options,
             times, sum);
  }
  return absl::OkStatus();
}

void BatchGradients::AddClips(absl::Span<const ClipTensors> clips, int64_t first_draw, const ClipStepOptions& options,
                              StepTimes& times, LossValues& sum) {
  const SteadyTime begin = parts_.clock->SteadyNow();
  std::vector<ClipStepResult> results(clips.size());
  ForEachShare(static_cast<int64_t>(clips.size()), {1, 1}, [&](int64_t i, int64_t end) {
    for (; i < end; ++i) {
      // Another stream of chance than the data's, which is seeded by the same number.
      Rng rng(MixSeed(seed_, ~uint64_t{0}), static_cast<uint64_t>(first_draw + i));
      results[i] = AddClipGradient(networks_[i].network(), clips[i].To(device_), options, rng, *parts_.clock);
    }
  });
  const absl::Duration took = parts_.clock->Since(begin);
  absl::Duration together;
  for (const ClipStepResult& result : results) together += result.times.total();
  for (size_t i = 0; i < clips.size(); ++i) {
    networks_[i].CollectGradients();
    AddTimes(results[i].times, together > took ? absl::FDivDuration(took, together) : 1, times);
    AddLoss(results[i].loss, sum);
  }
}

int64_t BatchGradients::skipped_samples() const {
  return skipped_before_ + (loader_ == nullptr ? 0 : loader_->skipped());
}

std::string BatchGradients::last_skip() const {
  return loader_ == nullptr || loader_->skipped() == 0 ? last_skip_before_ : loader_->last_error();
}

}  // namespace holdfast
