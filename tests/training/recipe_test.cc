// SPDX-License-Identifier: Apache-2.0
#include "training/recipe.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

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

}  // namespace
}  // namespace holdfast
