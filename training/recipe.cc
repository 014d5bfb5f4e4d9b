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

constexpr Limits kNoLimits;  // of what is no number
constexpr Limits AtLeast(double min) { return Limits{min}; }
constexpr Limits MoreThan(double min) { return Limits{min, kNoLimits.max, /*min_allowed=*/false}; }

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

bool Limits::Allow(double value) const {
  return (min_allowed ? value >= min : value > min) && (max_allowed ? value <= max : value < max);
}

std::string Limits::Text() const {
  const std::string above = min_allowed ? absl::StrCat(min, " or more") : absl::StrCat("above ", min);
  if (max == std::numeric_limits<double>::infinity()) return above;
  return absl::StrCat(above, " and ", max_allowed ? "at most " : "below ", max);
}

std::string RecipeField::Text(const Recipe& recipe) const {
  const RecipeValue value = get(recipe);
  if (const auto* integer = std::get_if<int64_t>(&value)) return absl::StrCat(*integer);
  if (const auto* number = std::get_if<double>(&value)) return absl::StrCat(*number);
  if (const auto* on = std::get_if<bool>(&value)) return *on ? "1" : "0";
  return AbslUnparseFlag(std::get<DistanceForm>(value));
}

absl::Status RecipeField::Check(const Recipe& recipe) const {
  const RecipeValue value = get(recipe);
  const auto* integer = std::get_if<int64_t>(&value);
  const auto* number = std::get_if<double>(&value);
  if (integer == nullptr && number == nullptr) return absl::OkStatus();
  if (limits.Allow(integer != nullptr ? static_cast<double>(*integer) : *number)) return absl::OkStatus();
  return Invalid(absl::StrCat(key, " (--", flag, ") must be ", limits.Text(), ", not ", Text(recipe)));
}

const std::vector<RecipeField>& RecipeFields() {
#define RECIPE_FIELD(key, flag, member, limits, help)                                      \
  {#key, #flag, limits, [](const Recipe& recipe) -> RecipeValue { return recipe.member; }, \
   [](Recipe& recipe, const RecipeValue& value) { recipe.member = std::get<decltype(recipe.member)>(value); }},
  static const std::vector<RecipeField> fields = {
#include "training/recipe_fields.inc"
  };
  return fields;
}

absl::Status Recipe::Validate() const {
  for (const RecipeField& field : RecipeFields()) {
    if (const absl::Status status = field.Check(*this); !status.ok()) return status;
  }
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

std::string Describe(const Recipe& recipe) {
  std::string text = absl::StrCat("name=", recipe.name);
  for (const RecipeField& field : RecipeFields()) absl::StrAppend(&text, " ", field.key, "=", field.Text(recipe));
  for (const Phase& phase : recipe.phases) {
    absl::StrAppend(&text, " phase=", phase.until, ":", phase.width, "x", phase.height, ":", phase.points, ":",
                    phase.iterations);
  }
  return text;
}

}  // namespace holdfast
