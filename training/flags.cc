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
#include "model/presets.h"
#include "training/recipe.h"

// The network and its recipe. A flag that is not given leaves what the preset says.
ABSL_FLAG(std::string, preset, "small", "network and recipe: paper, small or test");
ABSL_FLAG(std::optional<int64_t>, attention_blocks, std::nullopt, "of the contextual attention; 0: without");
ABSL_FLAG(std::optional<bool>, visibility_head, std::nullopt, "whether the network says if a point is visible");
ABSL_FLAG(std::string, init, "", "checkpoint to start from, of this or a similar network; empty: random weights");
ABSL_FLAG(absl::Duration, time_budget, absl::InfiniteDuration(), "of training, over all runs: 30m, 12h");
#define RECIPE_FIELD(key, flag, member, limits, help) \
  ABSL_FLAG(std::optional<decltype(holdfast::Recipe::member)>, flag, std::nullopt, help);
#include "training/recipe_fields.inc"
ABSL_FLAG(std::string, phases, "", "until:WIDTHxHEIGHT:points:iterations,... e.g. 0.7:256x192:64:3,1:320x256:64:4");

// The data.
ABSL_FLAG(std::string, format, "synthetic", "synthetic, pointodyssey or neutral");
ABSL_FLAG(std::string, data, "", "directory of the data set");
ABSL_FLAG(std::string, split, "train", "of pointodyssey");
ABSL_FLAG(std::string, pictures, "", "directory with objects/ and backgrounds/ for synthetic clips");
ABSL_FLAG(int64_t, clips, 0, "synthetic clips there are; 0: never the same twice");
ABSL_FLAG(bool, augment, true, "change recorded clips at random");
ABSL_FLAG(int, workers, 1, "threads that make clips");
ABSL_FLAG(uint64_t, seed, 0, "of all chance");

// The run.
ABSL_FLAG(std::string, out, "out/train", "directory of checkpoints, weights and logs; goes on from what is there");
ABSL_FLAG(std::string, device, "cpu", "as LibTorch names it: cpu, cuda, cuda:1");
ABSL_FLAG(int, threads, 0, "threads of one tensor operation; 0: all cores");
ABSL_FLAG(int64_t, checkpoint_every, 500, "steps; 0: at the end only");
ABSL_FLAG(int64_t, validate_every, 500, "steps; 0: never");
ABSL_FLAG(int64_t, validation_clips, 16, "in the validation set");
ABSL_FLAG(int64_t, validation_iterations, 4, "refinement iterations in validation");
ABSL_FLAG(bool, validate_on_training, false, "the training's first clips instead of clips of another seed or split");
ABSL_FLAG(int64_t, max_skipped, 25, "steps in a row without a finite gradient that end the training");
ABSL_FLAG(int64_t, log_every, 20, "steps between plain lines, where there is no terminal");
ABSL_FLAG(std::string, metrics_address, "", "host:port of Prometheus metrics; empty: none");

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
    std::vector<std::string> size;
    if (fields.size() == 4) size = absl::StrSplit(fields[1], 'x');
    if (size.size() != 2 || !absl::SimpleAtod(fields[0], &phase.until) || !absl::SimpleAtoi(size[0], &phase.width) ||
        !absl::SimpleAtoi(size[1], &phase.height) || !absl::SimpleAtoi(fields[2], &phase.points) ||
        !absl::SimpleAtoi(fields[3], &phase.iterations)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--phases: expected until:WIDTHxHEIGHT:points:iterations, got \"", part, "\""));
    }
    phases.push_back(phase);
  }
  return phases;
}

absl::StatusOr<TrainRequest> TrainRequestFromFlags() {
  TrainRequest request;
  absl::StatusOr<ModelOptions> network = NetworkFromFlags();
  if (!network.ok()) return network.status();
  absl::StatusOr<Recipe> recipe = RecipeFromFlags();
  if (!recipe.ok()) return recipe.status();
  request.network = *std::move(network);
  request.trainer.recipe = *std::move(recipe);
  try {
    request.trainer.device = torch::Device(absl::GetFlag(FLAGS_device));
  } catch (const c10::Error&) {
    return absl::InvalidArgumentError(
        absl::StrCat("--device: LibTorch does not know \"", absl::GetFlag(FLAGS_device), "\""));
  }
  DataFromFlags(request);
  RunFromFlags(request);
  const absl::Status status = CheckRun(request);
  if (!status.ok()) return status;
  return request;
}

}  // namespace holdfast
