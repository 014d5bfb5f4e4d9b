// SPDX-License-Identifier: Apache-2.0
#include "training/job.h"

#include <torch/utils.h>
#include <unistd.h>

#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/checkpoint/safetensors.h"
#include "model/presets.h"
#include "model/thread_count.h"
#include "training/data/loader.h"
#include "training/first_line.h"
#include "training/loss/clip_targets.h"
#include "training/precision_choice.h"
#include "training/report/console.h"
#include "training/report/log_files.h"
#include "training/report/metrics_port.h"
#include "training/training_checkpoint.h"
#include "training/warm_start.h"

namespace holdfast {
namespace {

absl::StatusOr<std::unique_ptr<ObserverList>> OpenLogs(const TrainRequest& request, const Clock& clock) {
  auto observers = std::make_unique<ObserverList>();
  observers->Add(MakeConsole(std::cout, {isatty(STDOUT_FILENO) != 0, request.log_every}));
  const std::string& directory = request.trainer.directory;
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error) return absl::PermissionDeniedError(absl::StrCat("cannot make ", directory, ": ", error.message()));
  absl::StatusOr<std::unique_ptr<TrainingObserver>> json = OpenJsonLog(directory + "/log.jsonl");
  if (!json.ok()) return json.status();
  observers->Add(*std::move(json));
  absl::StatusOr<std::unique_ptr<TrainingObserver>> events = OpenEventLog(directory + "/events", clock.WallNow());
  if (!events.ok()) return events.status();
  observers->Add(*std::move(events));
  if (request.metrics_address.empty()) return observers;
  absl::StatusOr<std::unique_ptr<TrainingMetrics>> metrics = TrainingMetrics::Listen(request.metrics_address);
  if (!metrics.ok()) return metrics.status();
  observers->Notice(absl::StrCat("metrics on port ", (*metrics)->port()));
  observers->Add(*std::move(metrics));
  return observers;
}

// Frames on which the norm after the attention is measured: those of the first training clip.
absl::StatusOr<torch::Tensor> CalibrationFrames(const TrainRequest& request) {
  const absl::StatusOr<std::unique_ptr<Dataset>> data =
      OpenTrainingData(request.data, request.trainer.recipe.phases.front());
  if (!data.ok()) return data.status();
  LoaderOptions options;
  options.workers = 0;
  options.seed = request.data.seed;
  const auto loader = Loader::Create(**data, options);
  if (!loader.ok()) return loader.status();
  const absl::StatusOr<std::vector<Sample>> samples = (*loader)->Next();
  if (!samples.ok()) return samples.status();
  const absl::StatusOr<ClipTensors> clip = ToTensors(samples->front(), request.network.stride);
  if (!clip.ok()) return clip.status();
  return clip->frames;
}

absl::Status StartFrom(const TrainRequest& request, PointModelImpl& model, TrainingObserver& observer) {
  const absl::StatusOr<TensorFile> file = ReadSafetensors(request.init);
  if (!file.ok()) return file.status();
  const absl::StatusOr<torch::Tensor> frames = CalibrationFrames(request);
  if (!frames.ok()) return frames.status();
  const absl::StatusOr<WarmStartReport> report = WarmStart(*file, *frames, model);
  if (!report.ok()) return absl::InvalidArgumentError(absl::StrCat("--init: ", report.status().message()));
  observer.Notice(absl::StrCat("starting from ", request.init, ": ", report->copied, " parameters copied, ",
                               report->padded.size(), " padded, ", report->fresh.size(), " fresh"));
  return absl::OkStatus();
}

// A training that goes on from a checkpoint needs no weights to start from.
// What a process but the first has to say to people: of its own samples, for example.
std::unique_ptr<ObserverList> NoticesOfOthers(const TrainRequest& request) {
  auto observers = std::make_unique<ObserverList>();
  observers->Add(MakeConsole(std::cerr, {false, request.log_every}));
  return observers;
}

absl::StatusOr<PointModel> MakeNetwork(const TrainRequest& request, TrainingObserver& observer) {
  torch::manual_seed(request.trainer.seed);
  PointModel model(request.network);
  if (!request.init.empty() && !HasTrainingCheckpoint(request.trainer.directory)) {
    const absl::Status status = StartFrom(request, *model, observer);
    if (!status.ok()) return status;
  }
  model->to(request.trainer.device);
  return model;
}

absl::StatusOr<std::optional<Validation>> OpenValidation(const TrainRequest& request) {
  if (request.validation_clips == 0 || request.trainer.validate_every == 0) return std::nullopt;
  const absl::StatusOr<std::unique_ptr<Dataset>> data =
      OpenTrainingData(request.validation_data, request.trainer.recipe.phases.back());
  if (!data.ok()) return data.status();
  absl::StatusOr<Validation> validation =
      Validation::Create(**data, request.validation_clips, request.validation_data.seed, request.validation_iterations);
  if (!validation.ok()) return validation.status();
  return *std::move(validation);
}

// What is trained may be finished on another machine: the recipe stays as it is.
TrainerOptions FitToMachine(const TrainRequest& request, const PointModel& model, TrainingObserver& observer) {
  TrainerOptions options = request.trainer;
  if (!options.recipe.bfloat16 || !request.choose_precision) return options;
  const std::optional<std::string> why = WhyNotBfloat16(model, options.recipe.phases);
  if (!why) return options;
  options.bfloat16_unfit = true;
  observer.Notice(absl::StrCat("training in float32: ", *why));
  return options;
}

std::string DescribeWait(const GroupOptions& options) {
  return absl::StrCat("waiting at ", options.address, ":", options.port, " until ", options.world,
                      " processes are there");
}

std::string Describe(const TrainRequest& request, const PointModelImpl& model, const ProcessGroup& group) {
  return absl::StrCat("network ", PresetName(request.network), ", ", model.ParameterCount(), " parameters; ",
                      group.world(), group.world() == 1 ? " process; " : " processes; ",
                      Describe(request.trainer.recipe));
}

std::string Describe(const TrainingSummary& summary) {
  const std::string end =
      absl::StrCat(summary.reason == StopReason::kFinished ? "finished" : "stopped", " at step ", summary.step);
  return summary.best < 0 ? end : absl::StrFormat("%s; best validation delta_vis %.1f", end, summary.best);
}

absl::StatusOr<StopReason> Train(const TrainRequest& request, const GroupOptions& options,
                                 const std::atomic<bool>& stop) {
  const SystemClock clock;
  torch::set_num_threads(ThreadCount(request.threads));
  cv::setNumThreads(1);  // clips are made in parallel, not their pixels: OpenCV's pool would take the network's cores
  const bool leads = options.rank == 0;
  // Before the others are waited for, so that logs and metrics tell of it when one does not come.
  auto observers = leads ? OpenLogs(request, clock) : NoticesOfOthers(request);
  if (!observers.ok()) return observers.status();
  if (options.world > 1) (*observers)->Notice(DescribeWait(options));
  auto group = ProcessGroup::Join(options, request.trainer.device.type());
  if (!group.ok()) return group.status();
  auto model = MakeNetwork(request, **observers);
  if (!model.ok()) return model.status();
  (*observers)->Notice(Describe(request, **model, **group));
  auto validation = leads ? OpenValidation(request) : std::nullopt;
  if (!validation.ok()) return validation.status();
  TrainingClips clips(request.data,
                      {request.trainer.recipe.batch_size, request.workers, (*group)->rank(), (*group)->world()});
  TrainerParts parts = {*model, &clips, nullptr, group->get(), observers->get(), &clock, &stop};
  if (validation->has_value()) parts.validation = &**validation;
  auto trainer = Trainer::Create(FitToMachine(request, *model, **observers), parts);
  if (!trainer.ok()) return trainer.status();
  const absl::StatusOr<TrainingSummary> summary = (*trainer)->Run();
  if (!summary.ok()) return summary.status();
  (*observers)->Notice(Describe(*summary));
  return summary->reason;
}

}  // namespace

absl::StatusOr<StopReason> RunTraining(const TrainRequest& request, const GroupOptions& options,
                                       const std::atomic<bool>& stop) {
  try {
    return Train(request, options, stop);
  } catch (const std::exception& e) {
    return absl::InternalError(absl::StrCat("the training failed: ", FirstLine(e)));
  }
}

}  // namespace holdfast
