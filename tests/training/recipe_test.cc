// SPDX-License-Identifier: Apache-2.0
#include "training/recipe.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/changed_recipe.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

template <typename... Fields>
constexpr size_t Count(const Fields&...) {
  return sizeof...(Fields);
}

// Numbers just outside a field's limits, and NaN where the field can hold it.
std::vector<RecipeValue> Refused(const RecipeField& field, const Recipe& recipe) {
  const auto& [min, max, min_allowed, max_allowed] = field.limits;
  std::vector<double> numbers;
  if (std::isfinite(min)) numbers.push_back(min_allowed ? min - 1 : min);
  if (std::isfinite(max)) numbers.push_back(max_allowed ? max + 1 : max);
  std::vector<RecipeValue> values;
  if (std::holds_alternative<double>(field.get(recipe))) {
    values.assign(numbers.begin(), numbers.end());
    values.emplace_back(std::nan(""));
  } else {
    for (const double number : numbers) values.emplace_back(static_cast<int64_t>(number));
  }
  return values;
}

TEST(RecipeTest, EveryPresetIsValidAndDescribesItselfDifferently) {
  std::set<std::string> lines;
  for (const std::string& name : RecipeNames()) {
    const auto recipe = RecipeByName(name);
    ASSERT_THAT(recipe, IsOk());
    EXPECT_THAT(recipe->Validate(), IsOk());
    lines.insert(Describe(*recipe));
  }
  EXPECT_EQ(lines.size(), RecipeNames().size());
  EXPECT_THAT(RecipeByName("large"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("paper, small, test")));
}

TEST(RecipeTest, ThePapersPresetHasNothingThatThePaperHasNot) {
  const Recipe paper = *RecipeByName("paper");
  EXPECT_EQ(paper.loss.form, DistanceForm::kPaper);
  EXPECT_DOUBLE_EQ(paper.loss.alpha, 0.15);
  EXPECT_EQ(paper.loss.matching_weight, 0);
  EXPECT_EQ(paper.streaming_windows, 0);
  EXPECT_EQ(paper.motion_ramp_clips, 0);
  EXPECT_EQ(paper.average_decay, 0);
  EXPECT_EQ(paper.phases.size(), 1u);
  EXPECT_EQ(paper.steps, 300000);
}

TEST(RecipeTest, PhasesFollowTheProgress) {
  Recipe recipe = *RecipeByName("test");
  recipe.phases = {{0.5, 48, 64, 8, 2}, {1.0, 96, 128, 8, 3}};
  EXPECT_EQ(recipe.PhaseAt(0).height, 48);
  EXPECT_EQ(recipe.PhaseAt(0.499).height, 48);
  EXPECT_EQ(recipe.PhaseAt(0.5).height, 96);
  EXPECT_EQ(recipe.PhaseAt(1).height, 96);
}

TEST(RecipeTest, TheMatchingLossFadesOut) {
  Recipe recipe = *RecipeByName("test");
  recipe.loss.matching_weight = 2;
  recipe.matching_until = 0.5;
  EXPECT_DOUBLE_EQ(recipe.LossAt(0).matching_weight, 2);
  EXPECT_DOUBLE_EQ(recipe.LossAt(0.25).matching_weight, 1);
  EXPECT_DOUBLE_EQ(recipe.LossAt(0.5).matching_weight, 0);
  EXPECT_DOUBLE_EQ(recipe.LossAt(0.9).matching_weight, 0);
}

TEST(RecipeTest, RefusesPhasesThatDoNotCoverTheTraining) {
  Recipe recipe = *RecipeByName("test");
  recipe.phases = {{0.5, 48, 64, 8, 2}};
  EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("end at 1")));
  recipe.phases = {{0.5, 48, 64, 8, 2}, {0.4, 48, 64, 8, 2}, {1, 48, 64, 8, 2}};
  EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument));
  recipe.phases = {{1, 50, 64, 8, 2}};
  EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("height")));
}

TEST(RecipeTest, AnyChangeShowsInItsDescription) {
  const Recipe recipe = *RecipeByName("small");
  Recipe other = recipe;
  other.loss.alpha = 0.5;
  EXPECT_NE(Describe(recipe), Describe(other));
  other = recipe;
  other.phases.back().points += 1;
  EXPECT_NE(Describe(recipe), Describe(other));
}

TEST(RecipeTest, EachPartOfAPhaseShowsInTheDescription) {
  const Recipe recipe = *RecipeByName("small");
  // A member more or less than these does not compile: the description must have it.
  const auto& [until, height, width, points, iterations] = recipe.phases.front();
  const std::vector<Phase> changed = {{until / 2, height, width, points, iterations},
                                      {until, height + 8, width, points, iterations},
                                      {until, height, width + 8, points, iterations},
                                      {until, height, width, points + 1, iterations},
                                      {until, height, width, points, iterations + 1}};
  for (const Phase& phase : changed) {
    Recipe other = recipe;
    other.phases.front() = phase;
    EXPECT_NE(Describe(recipe), Describe(other));
  }
}

TEST(RecipeTest, DescriptionsAreThoseOfCheckpointsThatThereAre) {
  EXPECT_EQ(Describe(*RecipeByName("small")),
            "name=small steps=0 batch_size=1 accumulate=1 frames=24 lr=0.0005 warm_up=0.05 start_divisor=25 "
            "end_divisor=250000 weight_decay=0.0001 clip_norm=1 average_decay=0.998 bf16=1 loss=paper gamma=0.8 "
            "alpha=0.15 visibility_loss=0.05 matching_loss=5 matching_until=0.5 noisy_start=0.5 "
            "streaming_windows=0.25 chain_start=0.75 motion_ramp_clips=400 phase=0.7:256x192:64:3 "
            "phase=1:320x256:64:4");
  Recipe published = *RecipeByName("paper");
  published.loss.form = DistanceForm::kPublished;
  EXPECT_EQ(Describe(published),
            "name=paper steps=300000 batch_size=2 accumulate=1 frames=24 lr=0.005 warm_up=0.05 start_divisor=25 "
            "end_divisor=250000 weight_decay=0.0001 clip_norm=1 average_decay=0 bf16=0 loss=published gamma=0.8 "
            "alpha=0.15 visibility_loss=0.05 matching_loss=0 matching_until=1 noisy_start=0.5 streaming_windows=0 "
            "chain_start=0 motion_ramp_clips=0 phase=1:512x384:128:6");
}

TEST(RecipeFieldsTest, EveryMemberOfARecipeHasARow) {
  // A member more or less than these does not compile: it needs a row of recipe_fields.inc.
  const Recipe recipe;
  const auto& [name, steps, batch_size, accumulate, frames, schedule, weight_decay, clip_norm, average_decay, bfloat16,
               loss, matching_until, noisy_start, streaming_windows, chain_start, motion_ramp_clips, phases] = recipe;
  const auto& [peak_rate, warm_up, start_divisor, end_divisor] = schedule;
  const auto& [form, gamma, alpha, visibility_weight, matching_weight] = loss;
  const size_t without_rows = Count(name, phases);  // the description has them all the same
  EXPECT_EQ(without_rows, 2u);
  EXPECT_EQ(RecipeFields().size(),
            Count(steps, batch_size, accumulate, frames, weight_decay, clip_norm, average_decay, bfloat16,
                  matching_until, noisy_start, streaming_windows, chain_start, motion_ramp_clips, peak_rate, warm_up,
                  start_divisor, end_divisor, form, gamma, alpha, visibility_weight, matching_weight));
}

TEST(RecipeFieldsTest, EachRowIsAFieldOfItsOwnThatShowsInTheDescription) {
  std::set<std::string> keys, flags;
  const Recipe recipe = *RecipeByName("test");
  for (const RecipeField& field : RecipeFields()) {
    keys.insert(field.key);
    flags.insert(field.flag);
    const Recipe changed = WithAnother(field, recipe);
    EXPECT_THAT(changed.Validate(), IsOk());
    EXPECT_THAT(Describe(changed), HasSubstr(absl::StrCat(" ", field.key, "=", field.Text(changed), " ")));
    for (const RecipeField& other : RecipeFields()) {
      EXPECT_EQ(other.Text(changed) != other.Text(recipe), &other == &field) << field.key << " and " << other.key;
    }
  }
  EXPECT_EQ(keys.size(), RecipeFields().size());
  EXPECT_EQ(flags.size(), RecipeFields().size());
}

TEST(RecipeFieldsTest, RefusesWhatIsOutsideTheLimitsByTheFieldsName) {
  const Recipe recipe = *RecipeByName("test");
  for (const RecipeField& field : RecipeFields()) {
    for (const RecipeValue& value : Refused(field, recipe)) {
      Recipe wrong = recipe;
      field.set(wrong, value);
      EXPECT_THAT(wrong.Validate(),
                  StatusIs(absl::StatusCode::kInvalidArgument,
                           HasSubstr(absl::StrCat("recipe: ", field.key, " (--", field.flag, ") must be "))));
    }
  }
}

TEST(RecipeFieldsTest, LimitsAreWhatSchedulesAndLossesCanDo) {
  EXPECT_THAT(Recipe().Validate(), IsOk());
  for (const ScheduleOptions& schedule : {ScheduleOptions{1, 0}, ScheduleOptions{1, 1}, ScheduleOptions{0, 0.1}}) {
    Recipe recipe;
    recipe.schedule = schedule;
    EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument));
  }
  Recipe recipe;
  recipe.loss.gamma = 1.5;
  EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("gamma")));
  recipe = {};
  recipe.loss.alpha = std::nan("");
  EXPECT_THAT(recipe.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("alpha")));
}

TEST(LimitsTest, SayWhatTheyAllow) {
  const double infinity = std::numeric_limits<double>::infinity();
  const Limits share = {0, 1};
  EXPECT_TRUE(share.Allow(0) && share.Allow(1));
  EXPECT_FALSE(share.Allow(-0.1) || share.Allow(1.1) || share.Allow(std::nan("")));
  EXPECT_EQ(share.Text(), "0 or more and at most 1");
  const Limits open = Limits{0, infinity, false}.LessThan(1);
  EXPECT_FALSE(open.Allow(0) || open.Allow(1));
  EXPECT_EQ(open.Text(), "above 0 and below 1");
  EXPECT_TRUE((Limits{2}.Allow(infinity)));
  EXPECT_EQ(Limits{2}.Text(), "2 or more");
}

}  // namespace
}  // namespace holdfast
