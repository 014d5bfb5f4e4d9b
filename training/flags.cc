// SPDX-License-Identifier: Apache-2.0
#include "training/flags.h"

#include <optional>
#include <utility>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "api/image_size.h"
#include "model/device.h"
#include "model/presets.h"
#include "training/recipe.h"

namespace holdfast {
namespace {

const TrainRequest& Defaults() {
  static const auto* const defaults = new TrainRequest;  // flags are made before main and may outlive statics
  return *defaults;
}

}  // namespace
}  // namespace holdfast

using holdfast::Defaults;

// The network.
ABSL_FLAG(
    std::string, preset, "small",
    "Names the network and its recipe: paper (the paper's figures, for GPUs), small (for two cores and an hour or "
    "more) or test (a few milliseconds a step).");
ABSL_FLAG(std::optional<int64_t>, attention_blocks, std::nullopt,
          "Gives the network's contextual attention this many blocks; 0: no attention. Not given: as the preset says.");
ABSL_FLAG(std::optional<bool>, visibility_head, std::nullopt,
          "Lets the network say whether a point is visible. Not given: as the preset says.");
ABSL_FLAG(std::string, init, Defaults().init,
          "Starts from the weights in this checkpoint, of this or a similar network. Empty: from random weights. A "
          "training that goes on does not read it.");

// The recipe. What is not given stays as the preset says.
#define RECIPE_FIELD(key, flag, member, limits, help) \
  ABSL_FLAG(std::optional<decltype(holdfast::Recipe::member)>, flag, std::nullopt, help);
#include "training/recipe_fields.inc"
ABSL_FLAG(std::string, phases, "",
          "Says on what clips which part of the training runs: until:WIDTHxHEIGHT:points:iterations of each phase, "
          "joined by commas, where 'until' is a share of the training and ends at 1; for example "
          "0.7:256x192:64:3,1:320x256:64:4. Empty: as the preset says.");

// The data.
ABSL_FLAG(std::string, format, Defaults().data.format,
          "Names the kind of clips: synthetic (made up, needs no files), pointodyssey or neutral (folders with frames/ "
          "and tracks.json).");
ABSL_FLAG(std::string, data, Defaults().data.dir,
          "Reads recorded clips from this directory; synthetic clips need none.");
ABSL_FLAG(std::string, split, Defaults().data.split,
          "Names the part of PointOdyssey to train on; train is validated on val.");
ABSL_FLAG(std::string, pictures, Defaults().data.pictures,
          "Takes the pictures of synthetic clips from this directory's objects/ and backgrounds/. Empty: procedural "
          "textures.");
ABSL_FLAG(int64_t, clips, Defaults().data.clips,
          "Makes this many different synthetic clips and repeats them, to see whether the network can learn them by "
          "heart. 0: no clip comes twice.");
ABSL_FLAG(double, alike_share, Defaults().data.alike_share,
          "Lets the objects of this share of the synthetic clips look like one another or like the background, where "
          "only what belongs together tells them apart. Validation clips follow it.");
ABSL_FLAG(bool, augment, Defaults().data.augment,
          "Changes recorded clips at random (colour, crop, scale, ...) each time they are seen.");
ABSL_FLAG(int, workers, Defaults().workers,
          "Makes clips with this many threads, beside those that compute. Raise it when steps wait for clips (data in "
          "the log).");
ABSL_FLAG(uint64_t, seed, Defaults().trainer.seed,
          "Seeds all chance: random weights, clips, their order and their windows. Another seed is another training.");

// The run. No library should write where nobody told it to, so the directory has no default but here.
ABSL_FLAG(std::string, out, "out/train",
          "Keeps checkpoints, weights and logs in this directory, and goes on from the newest checkpoint there.");
ABSL_FLAG(absl::Duration, time_budget, Defaults().trainer.time_budget,
          "Ends the training after this time (30m, 12h) over all its runs. With --steps=0 the learning rate and the "
          "phases follow it.");
ABSL_FLAG(std::string, device, Defaults().trainer.device.str(),
          "Trains on this device, as LibTorch names it: cpu, cuda, cuda:1.");
ABSL_FLAG(
    int, threads, Defaults().threads,
    "Computes with this many threads, each a clip of the batch (--batch_size) as long as there are clips enough; 0: as "
    "many as there are cores that the process may use. Lower it when several processes share a machine.");
ABSL_FLAG(
    int64_t, checkpoint_every, Defaults().trainer.checkpoint_every,
    "Writes a checkpoint whenever this many more steps are done, which is what a killed process loses at most. 0: at "
    "the end only.");
ABSL_FLAG(
    int64_t, validate_every, Defaults().trainer.validate_every,
    "Validates whenever this many more steps are done and keeps the best weights; training waits meanwhile. 0: never.");
ABSL_FLAG(int64_t, validation_clips, Defaults().validation_clips,
          "Validates on this many clips: more make the figures steadier and take longer. 0: no validation.");
ABSL_FLAG(int64_t, validation_iterations, Defaults().validation_iterations,
          "Lets the network refine positions this many times in validation.");
ABSL_FLAG(bool, validate_on_training, false,
          "Validates on the training's first clips instead of clips of another seed or split.");
ABSL_FLAG(int64_t, max_skipped, Defaults().trainer.max_skipped_in_row,
          "Ends the training with an error after this many steps in a row whose loss or gradient is not finite.");
ABSL_FLAG(
    int64_t, log_every, Defaults().log_every,
    "Prints a line whenever this many more steps are done, where standard output is no terminal; a terminal has a "
    "bar.");
ABSL_FLAG(std::string, metrics_address, Defaults().metrics_address,
          "Serves Prometheus metrics at this host:port. Empty: nowhere.");

namespace holdfast {
namespace {

constexpr uint64_t kValidationSeed = 1000003;  // of clips no training seed is likely to share

template <typename T>
void Override(const std::optional<T>& given, T& value) {
  if (given.has_value()) value = *given;
}

absl::StatusOr<ModelOptions> NetworkFromFlags() {
  absl::StatusOr<ModelOptions> network = PresetByName(absl::GetFlag(FLAGS_preset));
  if (!network.ok()) return absl::InvalidArgumentError(absl::StrCat("--preset: ", network.status().message()));
  Override(absl::GetFlag(FLAGS_attention_blocks), network->context_blocks);
  Override(absl::GetFlag(FLAGS_visibility_head), network->visibility_head);
  const absl::Status status = network->Validate();
  if (!status.ok()) return status;
  return network;
}

absl::StatusOr<Recipe> RecipeFromFlags() {
  absl::StatusOr<Recipe> recipe = RecipeByName(absl::GetFlag(FLAGS_preset));
  if (!recipe.ok()) return absl::InvalidArgumentError(absl::StrCat("--preset: ", recipe.status().message()));
#define RECIPE_FIELD(key, flag, member, limits, help) Override(absl::GetFlag(FLAGS_##flag), recipe->member);
#include "training/recipe_fields.inc"
  if (absl::GetFlag(FLAGS_phases).empty()) return recipe;
  absl::StatusOr<std::vector<Phase>> phases = ParsePhases(absl::GetFlag(FLAGS_phases));
  if (!phases.ok()) return phases.status();
  recipe->phases = *std::move(phases);
  return recipe;
}

void DataFromFlags(TrainRequest& request) {
  TrainingDataOptions& data = request.data;
  data.format = absl::GetFlag(FLAGS_format);
  data.dir = absl::GetFlag(FLAGS_data);
  data.split = absl::GetFlag(FLAGS_split);
  data.pictures = absl::GetFlag(FLAGS_pictures);
  data.clips = absl::GetFlag(FLAGS_clips);
  data.augment = absl::GetFlag(FLAGS_augment);
  data.alike_share = absl::GetFlag(FLAGS_alike_share);
  data.frames = request.trainer.recipe.frames;
  data.motion_ramp_clips = request.trainer.recipe.motion_ramp_clips;
  data.seed = absl::GetFlag(FLAGS_seed);
  TrainingDataOptions& validation = request.validation_data = data;
  validation.augment = false;
  if (absl::GetFlag(FLAGS_validate_on_training)) return;
  validation.motion_ramp_clips = 0;
  validation.clips = 0;
  validation.seed = kValidationSeed;
  if (data.format == "pointodyssey" && data.split == "train") validation.split = "val";
}

void RunFromFlags(TrainRequest& request) {
  TrainerOptions& trainer = request.trainer;
  trainer.directory = absl::GetFlag(FLAGS_out);
  trainer.seed = absl::GetFlag(FLAGS_seed);
  trainer.time_budget = absl::GetFlag(FLAGS_time_budget);
  trainer.checkpoint_every = absl::GetFlag(FLAGS_checkpoint_every);
  trainer.validate_every = absl::GetFlag(FLAGS_validate_every);
  trainer.max_skipped_in_row = absl::GetFlag(FLAGS_max_skipped);
  request.validation_clips = absl::GetFlag(FLAGS_validation_clips);
  request.validation_iterations = absl::GetFlag(FLAGS_validation_iterations);
  request.init = absl::GetFlag(FLAGS_init);
  request.metrics_address = absl::GetFlag(FLAGS_metrics_address);
  request.log_every = absl::GetFlag(FLAGS_log_every);
  request.workers = absl::GetFlag(FLAGS_workers);
  request.threads = absl::GetFlag(FLAGS_threads);
  request.choose_precision = !absl::GetFlag(FLAGS_bf16).has_value();
}

absl::Status CheckRun(const TrainRequest& request) {
  if (request.validation_clips < 0) return absl::InvalidArgumentError("--validation_clips must be 0 or more");
  if (request.validation_iterations < 1) return absl::InvalidArgumentError("--validation_iterations must be 1 or more");
  if (request.log_every < 1) return absl::InvalidArgumentError("--log_every must be 1 or more");
  if (request.workers < 0) return absl::InvalidArgumentError("--workers must be 0 or more");
  if (request.threads < 0) return absl::InvalidArgumentError("--threads must be 0 or more");
  if (request.data.clips < 0) return absl::InvalidArgumentError("--clips must be 0 or more");
  return request.trainer.Validate();
}

}  // namespace

absl::StatusOr<std::vector<Phase>> ParsePhases(const std::string& text) {
  std::vector<Phase> phases;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::vector<std::string> fields = absl::StrSplit(part, ':');
    Phase phase;
    absl::StatusOr<ImageSize> size = ImageSize();
    if (fields.size() == 4) size = ParseImageSize(fields[1]);
    if (fields.size() != 4 || !size.ok() || !absl::SimpleAtod(fields[0], &phase.until) ||
        !absl::SimpleAtoi(fields[2], &phase.points) || !absl::SimpleAtoi(fields[3], &phase.iterations)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--phases: expected until:WIDTHxHEIGHT:points:iterations, got \"", part, "\""));
    }
    phase.width = size->width;
    phase.height = size->height;
    phases.push_back(phase);
  }
  return phases;
}

absl::StatusOr<TrainRequest> TrainRequestFromFlags(const GroupOptions& group) {
  TrainRequest request;
  absl::StatusOr<ModelOptions> network = NetworkFromFlags();
  if (!network.ok()) return network.status();
  absl::StatusOr<Recipe> recipe = RecipeFromFlags();
  if (!recipe.ok()) return recipe.status();
  request.network = *std::move(network);
  request.trainer.recipe = *std::move(recipe);
  const absl::StatusOr<torch::Device> device = OpenDevice(DeviceOf(absl::GetFlag(FLAGS_device), group));
  if (!device.ok()) return absl::InvalidArgumentError(absl::StrCat("--device: ", device.status().message()));
  request.trainer.device = *device;
  DataFromFlags(request);
  RunFromFlags(request);
  const absl::Status status = CheckRun(request);
  if (!status.ok()) return status;
  return request;
}

}  // namespace holdfast
