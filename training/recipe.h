// SPDX-License-Identifier: Apache-2.0
// How a network is trained, as data: presets are named rows, and a checkpoint carries the recipe it was made by.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "training/loss/losses.h"
#include "training/schedule.h"

namespace holdfast {

// A stretch of the training with clips of one kind.
struct Phase {
  double until = 1;  // share of the training at which it ends; the last phase has 1
  int64_t height = 384;
  int64_t width = 512;
  int64_t points = 128;
  int64_t iterations = 6;  // K
};

// Fields that are one value each have a row in recipe_fields.inc, with their limits.
struct Recipe {
  std::string name;        // of the preset, "paper" or "small", or what the user changed it into
  int64_t steps = 0;       // optimizer steps; 0: as many as the time budget allows, the schedule follows the time
  int64_t batch_size = 1;  // clips a loader batch of each process
  int64_t accumulate = 1;  // loader batches an optimizer step
  int64_t frames = 24;     // S
  ScheduleOptions schedule;
  double weight_decay = 1e-4;
  double clip_norm = 1;      // largest norm of the gradient
  double average_decay = 0;  // of the moving average of the weights that is validated and shipped; 0: the weights
  bool bfloat16 = false;     // the network runs in bfloat16, the optimizer in float32
  LossOptions loss;
  double matching_until = 1;      // the matching loss fades out linearly until this share of the training
  double noisy_start = 0.5;       // probability of a start between noise and truth instead of zero velocity
  double streaming_windows = 0;   // probability of a window as the engine has them: a repeated tail or a continuation
  double chain_start = 0;         // probability that a start goes on by optical flow instead of standing still
  int64_t motion_ramp_clips = 0;  // synthetic clips until motion has its full strength; 0: from the first
  std::vector<Phase> phases = std::vector<Phase>(1);

  // INVALID_ARGUMENT names the field and its flag.
  absl::Status Validate() const;
  // The phase at 'progress' in [0, 1].
  const Phase& PhaseAt(double progress) const;
  // 'loss' with the matching loss as weak as it is at 'progress'.
  LossOptions LossAt(double progress) const;
};

// "paper", "small" or "test" (a few milliseconds a step); NOT_FOUND lists the names. A preset of the network (model/
// presets.h) has the recipe of its name.
absl::StatusOr<Recipe> RecipeByName(absl::string_view name);
std::vector<std::string> RecipeNames();

// One line with every field: two recipes are the same if and only if their lines are. A checkpoint keeps it, and a
// training goes on only where it is the same, so what it says of a recipe may not change.
std::string Describe(const Recipe& recipe);

// The numbers that a field may have. NaN is never among them.
struct Limits {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool min_allowed = true;
  bool max_allowed = true;

  constexpr Limits AtMost(double value) const { return {min, value, min_allowed, true}; }
  constexpr Limits LessThan(double value) const { return {min, value, min_allowed, false}; }
  bool Allow(double value) const;
  // What a number must be: "0 or more", "above 0 and at most 1".
  std::string Text() const;
};

using RecipeValue = std::variant<int64_t, double, bool, DistanceForm>;

// A row of recipe_fields.inc.
struct RecipeField {
  const char* key;   // in descriptions
  const char* flag;  // of holdfast-train
  Limits limits;     // of numbers
  RecipeValue (*get)(const Recipe& recipe);
  void (*set)(Recipe& recipe, const RecipeValue& value);  // REQUIRES: the type that 'get' returns

  // As descriptions and the flag have it: "24", "0.8", "1" for true, "paper".
  std::string Text(const Recipe& recipe) const;
  absl::Status Check(const Recipe& recipe) const;
};

// Every field but the name and the phases, in the order of descriptions.
const std::vector<RecipeField>& RecipeFields();

}  // namespace holdfast
