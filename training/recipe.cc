// SPDX-License-Identifier: Apache-2.0
#include "training/recipe.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

// The paper's: eq. 3 and the published hyperparameters, nothing else.
Recipe PaperRecipe() {
  Recipe recipe;
  recipe.name = "paper";
  recipe.steps = 300000;
  recipe.batch_size = 2;
  recipe.schedule.peak_rate = 5e-3;
  return recipe;
}

// For two cores and an hour or more: small clips first, the encoder taught directly while it knows nothing, then the
// windows that the server will show it.
Recipe SmallRecipe() {
  Recipe recipe;
  recipe.name = "small";
  recipe.schedule.peak_rate = 5e-4;
  recipe.average_decay = 0.998;
  recipe.bfloat16 = true;
  recipe.loss.matching_weight = 5;
  recipe.matching_until = 0.5;
  recipe.streaming_windows = 0.25;
  recipe.chain_start = 0.75;
  recipe.motion_ramp_clips = 400;
  recipe.phases = {{0.7, 192, 256, 64, 3}, {1.0, 256, 320, 64, 4}};
  return recipe;
}

Recipe TestRecipe() {
  Recipe recipe;
  recipe.name = "test";
  recipe.steps = 8;
  recipe.frames = 6;
  recipe.average_decay = 0.9;
  recipe.loss.matching_weight = 1;
  recipe.streaming_windows = 0.25;
  recipe.chain_start = 0.75;
  recipe.phases = {{1.0, 48, 64, 8, 2}};
  return recipe;
}

absl::Status Invalid(absl::string_view what) { return absl::InvalidArgumentError(absl::StrCat("recipe: ", what)); }

bool IsShare(double value) { return value >= 0 && value <= 1; }

absl::Status ValidatePhases(const std::vector<Phase>& phases) {
  double begin = 0;
  for (const Phase& phase : phases) {
    if (!(phase.until > begin)) return Invalid("phases must end one after the other");
    if (phase.height <= 0 || phase.height % 8 != 0) return Invalid("the height must be a positive multiple of 8");
    if (phase.width <= 0 || phase.width % 8 != 0) return Invalid("the width must be a positive multiple of 8");
    if (phase.points <= 0) return Invalid("points must be positive");
    if (phase.iterations <= 0) return Invalid("iterations must be positive");
    begin = phase.until;
  }
  return begin == 1 ? absl::OkStatus() : Invalid("the last phase must end at 1");
}

}  // namespace

absl::Status Recipe::Validate() const {
  if (steps < 0) return Invalid("steps must be 0 or more");
  if (batch_size <= 0) return Invalid("the batch size must be positive");
  if (accumulate <= 0) return Invalid("accumulate must be positive");
  if (frames < 2) return Invalid("a clip needs 2 frames or more");
  if (!(weight_decay >= 0)) return Invalid("the weight decay must be 0 or more");
  if (!(clip_norm > 0)) return Invalid("the clipping norm must be positive");
  if (!(average_decay >= 0 && average_decay < 1)) return Invalid("the decay of the average must be in [0, 1)");
  if (!(matching_until > 0 && matching_until <= 1)) return Invalid("the end of the matching loss must be in (0, 1]");
  if (!IsShare(noisy_start)) return Invalid("the share of noisy starts must be in [0, 1]");
  if (!IsShare(streaming_windows)) return Invalid("the share of streaming windows must be in [0, 1]");
  if (!IsShare(chain_start)) return Invalid("the share of chained starts must be in [0, 1]");
  if (motion_ramp_clips < 0) return Invalid("the motion ramp must be 0 clips or more");
  if (const absl::Status status = schedule.Validate(); !status.ok()) return status;
  if (const absl::Status status = loss.Validate(); !status.ok()) return status;
  return ValidatePhases(phases);
}

const Phase& Recipe::PhaseAt(double progress) const {
  for (const Phase& phase : phases) {
    if (progress < phase.until) return phase;
  }
  return phases.back();
}

LossOptions Recipe::LossAt(double progress) const {
  LossOptions now = loss;
  now.matching_weight *= progress < matching_until ? 1 - progress / matching_until : 0;
  return now;
}

absl::StatusOr<Recipe> RecipeByName(absl::string_view name) {
  for (const Recipe& recipe : {PaperRecipe(), SmallRecipe(), TestRecipe()}) {
    if (recipe.name == name) return recipe;
  }
  return absl::NotFoundError(absl::StrCat("no recipe '", name, "'; there are ", absl::StrJoin(RecipeNames(), ", ")));
}

std::vector<std::string> RecipeNames() { return {"paper", "small", "test"}; }

std::string Describe(const Recipe& r) {
  std::string text =
      absl::StrCat("name=", r.name, " steps=", r.steps, " batch_size=", r.batch_size, " accumulate=", r.accumulate,
                   " frames=", r.frames, " lr=", r.schedule.peak_rate, " warm_up=", r.schedule.warm_up,
                   " start_divisor=", r.schedule.start_divisor, " end_divisor=", r.schedule.end_divisor,
                   " weight_decay=", r.weight_decay, " clip_norm=", r.clip_norm, " average_decay=", r.average_decay,
                   " bf16=", static_cast<int>(r.bfloat16));
  absl::StrAppend(&text, " loss=", r.loss.form == DistanceForm::kPaper ? "paper" : "published", " gamma=", r.loss.gamma,
                  " alpha=", r.loss.alpha, " visibility_loss=", r.loss.visibility_weight,
                  " matching_loss=", r.loss.matching_weight, " matching_until=", r.matching_until,
                  " noisy_start=", r.noisy_start, " streaming_windows=", r.streaming_windows,
                  " chain_start=", r.chain_start, " motion_ramp_clips=", r.motion_ramp_clips);
  for (const Phase& phase : r.phases) {
    absl::StrAppend(&text, " phase=", phase.until, ":", phase.width, "x", phase.height, ":", phase.points, ":",
                    phase.iterations);
  }
  return text;
}

}  // namespace holdfast
