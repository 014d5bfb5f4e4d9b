// SPDX-License-Identifier: Apache-2.0
#include "training/trainer.h"

#include <torch/optim/adamw.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"
#include "model/checkpoint/checkpoint.h"
#include "training/batch_gradients.h"
#include "training/first_line.h"
#include "training/gradient.h"
#include "training/optimizer_archive.h"
#include "training/schedule.h"
#include "training/training_checkpoint.h"
#include "training/weight_average.h"

namespace holdfast {
namespace {

// What travels with the gradients, as sums over processes: the loss in the order of its columns, then these.
enum Extra : size_t { kStop = kLossColumns.size(), kProgress, kSkippedSamples, kExtraCount };

void PutLoss(const LossValues& loss, std::vector<double>& extra) {
  for (size_t i = 0; i < kLossColumns.size(); ++i) extra[i] = loss.*kLossColumns[i].value;
}

// The mean over 'clips' of what PutLoss put in.
LossValues MeanLoss(const std::vector<double>& extra, int64_t clips) {
  LossValues mean = {};
  for (size_t i = 0; i < kLossColumns.size(); ++i) mean.*kLossColumns[i].value = extra[i] / static_cast<double>(clips);
  return mean;
}

torch::optim::AdamWOptions OptimizerOptions(const Recipe& recipe) {
  return torch::optim::AdamWOptions(recipe.schedule.peak_rate).weight_decay(recipe.weight_decay);
}

torch::ScalarType NetworkType(const TrainerOptions& options) {
  return options.recipe.bfloat16 && !options.bfloat16_unfit ? torch::kBFloat16 : torch::kFloat32;
}

class TrainerImpl : public Trainer {
 public:
  TrainerImpl(const TrainerOptions& options, const TrainerParts& parts)
      : options_(options),
        parts_(parts),
        gradients_(options_.recipe, options.seed, options.device,
                   {parts.model, NetworkType(options), parts.clips, parts.group, parts.clock}),
        average_(*parts.model, options.recipe.average_decay),
        optimizer_(parts.model->parameters(), OptimizerOptions(options.recipe)) {
    state_.seed = options.seed;
    state_.recipe = Describe(options.recipe);
    state_.world = parts.group->world();
  }

  absl::Status Resume();
  absl::Status AgreeOnStart();
  absl::StatusOr<TrainingSummary> Run() override;

 private:
  const Recipe& recipe() const { return options_.recipe; }
  bool leads() const { return parts_.group->rank() == 0; }
  int64_t DrawsOfBatch() const { return recipe().batch_size * parts_.group->world(); }
  bool Done() const { return progress_ >= 1; }
  bool AfterLastStep() const { return Done() || stop_; }  // the same in every process
  absl::Duration Elapsed() const { return elapsed_before_ + parts_.clock->Since(run_began_); }

  absl::Status TrainAndWrite();
  absl::Status Loop();
  absl::Status EndTogether(const absl::Status& mine);
  absl::Status Step();
  absl::Status Update(StepReport& report, std::vector<double>& extra);
  absl::Status Guard(bool finite);
  void Finish(StepReport& report, const std::vector<double>& extra);
  void TellOfSkips();
  double ProgressAt(int64_t step, absl::Duration elapsed) const;
  absl::Status Validate();
  absl::Status Checkpoint();
  absl::Status SaveAverage(const std::string& name);

  const TrainerOptions options_;
  TrainerParts parts_;
  BatchGradients gradients_;
  WeightAverage average_;
  torch::optim::AdamW optimizer_;
  TrainingState state_;  // but for the optimizer and the average, which are filled in when it is saved
  double progress_ = 0;  // share of the training done
  SteadyTime run_began_;
  absl::Duration elapsed_before_;  // in earlier runs
  int64_t saved_step_ = -1;        // of the checkpoint written or resumed from last; below 0: none
  int64_t skipped_in_row_ = 0;
  int64_t told_skips_ = 0;
  bool stop_ = false;
};

absl::Status TrainerImpl::Resume() {
  absl::StatusOr<std::optional<TrainingCheckpoint>> found = FindTrainingCheckpoint(options_.directory);
  if (!found.ok()) return found.status();
  if (!found->has_value()) return absl::OkStatus();
  TrainingCheckpoint& checkpoint = **found;
  if (checkpoint.state.recipe != state_.recipe || checkpoint.state.seed != state_.seed) {
    return absl::FailedPreconditionError(
        absl::StrCat(checkpoint.path, " was made by another recipe: it has seed=", checkpoint.state.seed, " ",
                     checkpoint.state.recipe, "; wanted is seed=", state_.seed, " ", state_.recipe));
  }
  absl::Status status = CopyParameters(checkpoint.weights, *parts_.model);
  if (!status.ok()) {
    return absl::FailedPreconditionError(
        absl::StrCat(checkpoint.path, " was made for another network: ", status.message()));
  }
  status = LoadOptimizer(checkpoint.state.optimizer, optimizer_);
  if (status.ok()) status = average_.Restore(checkpoint.state.average, checkpoint.state.average_updates);
  if (!status.ok()) return absl::DataLossError(absl::StrCat(checkpoint.path, ": ", status.message()));
  state_ = std::move(checkpoint.state);
  const int64_t world_before = std::exchange(state_.world, parts_.group->world());
  if (world_before == 0) state_.next_draw *= DrawsOfBatch();
  saved_step_ = state_.step;
  progress_ = ProgressAt(state_.step, state_.elapsed);
  gradients_.Refresh();
  if (leads()) {
    if (!checkpoint.skipped.empty()) parts_.observer->Notice(absl::StrCat("passed over: ", checkpoint.skipped));
    parts_.observer->Notice(absl::StrCat("going on from step ", state_.step, " (", checkpoint.path, ")"));
    if (world_before != 0 && world_before != state_.world) {
      parts_.observer->Notice(absl::StrCat("processes: ", world_before, " before, ", state_.world, " now; a step has ",
                                           DrawsOfBatch() * recipe().accumulate, " clips"));
    }
  }
  return absl::OkStatus();
}

// Every process must be at the same step with the same weights.
absl::Status TrainerImpl::AgreeOnStart() {
  torch::NoGradGuard no_grad;
  const double mine = static_cast<double>(state_.step);
  torch::Tensor step = torch::full({1}, mine, torch::TensorOptions(torch::kFloat64).device(options_.device));
  absl::Status status = parts_.group->Broadcast(step);
  for (const torch::Tensor& parameter : parts_.model->parameters()) {
    if (!status.ok()) return status;
    torch::Tensor values = parameter.detach();
    status = parts_.group->Broadcast(values);
  }
  if (!status.ok()) return status;
  gradients_.Refresh();
  if (step.item<double>() == mine) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat("rank ", parts_.group->rank(), " is at step ", state_.step,
                                                    ", rank 0 at ", step.item<double>(),
                                                    ": all must see the same directory"));
}

absl::StatusOr<TrainingSummary> TrainerImpl::Run() {
  run_began_ = parts_.clock->SteadyNow();
  elapsed_before_ = state_.elapsed;
  absl::Status status = TrainAndWrite();
  if (AfterLastStep()) status = EndTogether(status);
  if (!status.ok()) return status;
  return TrainingSummary{Done() ? StopReason::kFinished : StopReason::kAsked, state_.step, state_.best};
}

absl::Status TrainerImpl::TrainAndWrite() {
  try {
    absl::Status status = Loop();
    if (status.ok()) status = Checkpoint();
    if (status.ok() && Done() && leads()) status = SaveAverage("final.safetensors");
    return status;
  } catch (const std::exception& e) {
    return absl::InternalError(absl::StrCat("at step ", state_.step + 1, ": ", FirstLine(e)));
  }
}

// Rank 0 may still fail when the steps are done, as it validates and writes the files. No other process may look
// complete before: nobody would start it again, and rank 0 would wait for it in vain.
absl::Status TrainerImpl::EndTogether(const absl::Status& mine) {
  torch::Tensor failed =
      torch::full({1}, mine.ok() ? 0 : 1, torch::TensorOptions(torch::kFloat32).device(options_.device));
  const absl::Status status = parts_.group->Sum(failed);
  if (!mine.ok()) return mine;
  if (!status.ok()) return status;
  if (failed.item<float>() == 0) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("rank ", parts_.group->rank(), ": another process failed after the last step, and says why"));
}

absl::Status TrainerImpl::Loop() {
  const auto is_due = [&](int64_t every) { return every > 0 && state_.step % every == 0; };
  absl::Status status = state_.step == 0 ? Validate() : absl::OkStatus();
  while (status.ok() && !AfterLastStep()) {
    status = Step();
    if (status.ok() && (is_due(options_.validate_every) || Done())) status = Validate();
    if (status.ok() && is_due(options_.checkpoint_every)) status = Checkpoint();
  }
  return status;
}

absl::Status TrainerImpl::Step() {
  StepReport report;
  report.learning_rate = LearningRate(recipe().schedule, progress_);
  static_cast<torch::optim::AdamWOptions&>(optimizer_.param_groups()[0].options()).lr(report.learning_rate);
  LossValues sum = {};
  absl::Status status;
  for (int64_t i = 0; status.ok() && i < recipe().accumulate; ++i) {
    status = gradients_.Add(state_.next_draw, progress_, report.times, sum);
    state_.next_draw += DrawsOfBatch();
  }
  std::vector<double> extra(kExtraCount, 0.0);
  PutLoss(sum, extra);
  if (status.ok()) status = Update(report, extra);
  if (!status.ok()) return status;
  Finish(report, extra);
  return Guard(!report.skipped);
}

double TrainerImpl::ProgressAt(int64_t step, absl::Duration elapsed) const {
  const double by_time = std::min(absl::FDivDuration(elapsed, options_.time_budget), 1.0);
  if (recipe().steps == 0 || by_time >= 1) return by_time;
  return std::min(static_cast<double>(step) / static_cast<double>(recipe().steps), 1.0);
}

absl::Status TrainerImpl::Update(StepReport& report, std::vector<double>& extra) {
  const SteadyTime begin = parts_.clock->SteadyNow();
  extra[kStop] = parts_.stop->load() ? 1 : 0;
  extra[kSkippedSamples] = static_cast<double>(gradients_.skipped_samples());
  extra[kProgress] = leads() ? ProgressAt(state_.step + 1, Elapsed()) : 0;
  report.clips = DrawsOfBatch() * recipe().accumulate;
  const double share = 1.0 / static_cast<double>(report.clips);
  absl::StatusOr<torch::Tensor> gradient = SumGradients(parts_.model->parameters(), share, *parts_.group, extra);
  if (!gradient.ok()) return gradient.status();
  report.gradient_norm = ClipGradient(*gradient, recipe().clip_norm);
  report.loss = MeanLoss(extra, report.clips);
  report.skipped = !std::isfinite(report.gradient_norm) || !std::isfinite(report.loss.total);
  if (!report.skipped) {
    optimizer_.step();
    average_.Update(*parts_.model);
    gradients_.Refresh();
  }
  ClearGradients(parts_.model->parameters());
  report.times.update = parts_.clock->Since(begin);
  return absl::OkStatus();
}

void TrainerImpl::Finish(StepReport& report, const std::vector<double>& extra) {
  stop_ = extra[kStop] > 0;
  state_.step += 1;
  // Single precision on the wire must not end a training early or late.
  progress_ =
      recipe().steps > 0 && extra[kProgress] < 1 ? ProgressAt(state_.step, absl::ZeroDuration()) : extra[kProgress];
  state_.skipped_steps += report.skipped ? 1 : 0;
  report.step = state_.step;
  report.steps = recipe().steps;
  report.progress = progress_;
  report.when = parts_.clock->WallNow();
  report.elapsed = Elapsed();
  report.skipped_steps = state_.skipped_steps;
  report.skipped_samples = std::llround(extra[kSkippedSamples]);
  report.bfloat16 = NetworkType(options_) == torch::kBFloat16;
  if (leads()) parts_.observer->StepDone(report);
  TellOfSkips();
}

// At the first damaged sample of this process, and then whenever there are twice as many as it told of last.
void TrainerImpl::TellOfSkips() {
  const int64_t skipped = gradients_.skipped_samples();
  if (skipped == 0 || skipped < 2 * told_skips_) return;
  told_skips_ = skipped;
  parts_.observer->Notice(
      absl::StrCat("rank ", parts_.group->rank(), " has skipped ", skipped,
                   skipped == 1 ? " damaged sample: " : " damaged samples; the last: ", gradients_.last_skip()));
}

absl::Status TrainerImpl::Guard(bool finite) {
  skipped_in_row_ = finite ? 0 : skipped_in_row_ + 1;
  if (skipped_in_row_ < options_.max_skipped_in_row) return absl::OkStatus();
  return absl::AbortedError(absl::StrCat(skipped_in_row_, " steps in a row, up to step ", state_.step,
                                         ", had a loss or gradient that is not finite"));
}

absl::Status TrainerImpl::Validate() {
  if (parts_.validation == nullptr || options_.validate_every == 0 || !leads()) return absl::OkStatus();
  const SteadyTime begin = parts_.clock->SteadyNow();
  PointModel network(parts_.model->options());
  network->to(options_.device);
  average_.CopyTo(*network);
  const absl::StatusOr<Metrics> metrics = parts_.validation->Run(*network, options_.device);
  if (!metrics.ok()) return metrics.status();
  ValidationReport report;
  report.step = state_.step;
  report.when = parts_.clock->WallNow();
  report.took = parts_.clock->Since(begin);
  report.metrics = *metrics;
  report.best = metrics->delta_vis.value_or(-1) > state_.best;
  parts_.observer->Validated(report);
  if (!metrics->delta_vis) return absl::OkStatus();
  state_.validated = *metrics->delta_vis;
  state_.validated_step = state_.step;
  if (!report.best) return absl::OkStatus();
  state_.best = state_.validated;
  return SaveAverage("best.safetensors");
}

absl::Status TrainerImpl::SaveAverage(const std::string& name) {
  PointModel network(parts_.model->options());
  average_.CopyTo(*network);
  std::map<std::string, std::string> metadata = {{"holdfast.recipe", state_.recipe},
                                                 {"holdfast.seed", absl::StrCat(state_.seed)},
                                                 {"holdfast.step", absl::StrCat(state_.step)}};
  if (state_.validated_step == state_.step) {
    metadata["holdfast.validation_delta_vis"] = absl::StrCat(state_.validated);
  }
  return SaveModel(absl::StrCat(options_.directory, "/", name), *network, torch::kFloat32, metadata);
}

absl::Status TrainerImpl::Checkpoint() {
  if (!leads() || saved_step_ == state_.step) return absl::OkStatus();
  absl::StatusOr<std::string> optimizer = SaveOptimizer(optimizer_);
  if (!optimizer.ok()) return optimizer.status();
  TrainingState state = state_;
  state.elapsed = Elapsed();
  state.optimizer = *std::move(optimizer);
  state.average = average_.tensors();
  state.average_updates = average_.updates();
  const absl::Status status = SaveTrainingCheckpoint(options_.directory, *parts_.model, state, parts_.clock->WallNow());
  if (status.ok()) saved_step_ = state_.step;
  return status;
}

}  // namespace

absl::Status TrainerOptions::Validate() const {
  if (const absl::Status status = recipe.Validate(); !status.ok()) return status;
  if (directory.empty()) return absl::InvalidArgumentError("a directory for checkpoints is needed");
  if (!(time_budget > absl::ZeroDuration())) return absl::InvalidArgumentError("the time budget must be positive");
  if (recipe.steps == 0 && time_budget == absl::InfiniteDuration()) {
    return absl::InvalidArgumentError("a number of steps or a time budget is needed");
  }
  if (validate_every < 0 || checkpoint_every < 0) return absl::InvalidArgumentError("steps between must be 0 or more");
  if (max_skipped_in_row < 1) return absl::InvalidArgumentError("the number of skipped steps must be 1 or more");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<Trainer>> Trainer::Create(const TrainerOptions& options, const TrainerParts& parts) {
  if (const absl::Status status = options.Validate(); !status.ok()) return status;
  try {
    auto trainer = std::make_unique<TrainerImpl>(options, parts);
    absl::Status status = trainer->Resume();
    if (status.ok()) status = trainer->AgreeOnStart();
    if (!status.ok()) return status;
    // All have joined: no process of an earlier run still writes.
    if (parts.group->rank() == 0) RemoveTemporaryFiles(options.directory);
    return trainer;
  } catch (const std::exception& e) {
    return absl::InternalError(absl::StrCat("cannot start the training: ", FirstLine(e)));
  }
}

}  // namespace holdfast
