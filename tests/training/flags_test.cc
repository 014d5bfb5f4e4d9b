// SPDX-License-Identifier: Apache-2.0
#include "training/flags.h"

#include <gtest/gtest.h>

#include "absl/flags/commandlineflag.h"
#include "absl/flags/reflection.h"
#include "absl/strings/str_cat.h"
#include "program/flags.h"
#include "tests/support/changed_recipe.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;

absl::StatusOr<TrainRequest> Request(const std::vector<std::string>& args, const GroupOptions& group = {}) {
  const absl::FlagSaver saver;
  const auto rest = ParseFlags(args);
  if (!rest.ok()) return rest.status();
  return TrainRequestFromFlags(group);
}

TEST(TrainFlagsTest, APresetNamesNetworkAndRecipe) {
  const auto request = Request({"--preset=paper"});
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->network.context_blocks, 6);
  EXPECT_EQ(Describe(request->trainer.recipe), Describe(*RecipeByName("paper")));
}

TEST(TrainFlagsTest, FlagsChangeWhatThePresetSays) {
  const auto request = Request({"--preset=paper", "--attention_blocks=0", "--alpha=0", "--loss=published", "--steps=7",
                                "--matching_loss=2", "--streaming_windows=0.5", "--bf16=true", "--seed=4", "--lr=0.001",
                                "--phases=0.5:64x32:16:3,1:128x96:32:4", "--time_budget=90s"});
  ASSERT_THAT(request, IsOk());
  const Recipe& recipe = request->trainer.recipe;
  EXPECT_EQ(request->network.context_blocks, 0);
  EXPECT_EQ(recipe.loss.alpha, 0);
  EXPECT_EQ(recipe.loss.form, DistanceForm::kPublished);
  EXPECT_EQ(recipe.steps, 7);
  EXPECT_EQ(recipe.loss.matching_weight, 2);
  EXPECT_EQ(recipe.streaming_windows, 0.5);
  EXPECT_TRUE(recipe.bfloat16);
  EXPECT_EQ(recipe.schedule.peak_rate, 0.001);
  ASSERT_EQ(recipe.phases.size(), 2u);
  EXPECT_EQ(recipe.phases[0].width, 64);
  EXPECT_EQ(recipe.phases[1].iterations, 4);
  EXPECT_EQ(request->trainer.time_budget, absl::Seconds(90));
  EXPECT_EQ(request->trainer.seed, 4u);
  EXPECT_EQ(request->data.seed, 4u);
}

TEST(TrainFlagsTest, EveryFieldOfTheRecipeHasAFlagThatSetsItAlone) {
  const Recipe preset = *RecipeByName("test");
  for (const RecipeField& field : RecipeFields()) {
    const absl::CommandLineFlag* flag = absl::FindCommandLineFlag(field.flag);
    ASSERT_NE(flag, nullptr) << field.flag;
    EXPECT_EQ(flag->DefaultValue(), "") << field.flag;
    EXPECT_THAT(flag->Help(), EndsWith(".")) << field.flag;
    const Recipe wanted = WithAnother(field, preset);
    const auto request = Request({"--preset=test", absl::StrCat("--", field.flag, "=", field.Text(wanted))});
    ASSERT_THAT(request, IsOk()) << field.flag;
    EXPECT_EQ(Describe(request->trainer.recipe), Describe(wanted));
  }
}

TEST(TrainFlagsTest, AProcessOpensTheDeviceOfItsLocalRankAlone) {
  GroupOptions group;
  group.local_rank = 99;  // no machine has as many
  EXPECT_THAT(Request({"--preset=test", "--device=cuda"}, group),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("cuda:99")));
  EXPECT_THAT(Request({"--preset=test", "--device=cpu"}, group), IsOk());
}

TEST(TrainFlagsTest, ValidationClipsAreHeldOut) {
  const auto held_out = Request({"--preset=test", "--clips=1"});
  ASSERT_THAT(held_out, IsOk());
  EXPECT_NE(held_out->validation_data.seed, held_out->data.seed);
  EXPECT_EQ(held_out->validation_data.clips, 0);
  const auto same = Request({"--preset=test", "--clips=1", "--validate_on_training"});
  ASSERT_THAT(same, IsOk());
  EXPECT_EQ(same->validation_data.seed, same->data.seed);
  const auto recorded = Request({"--preset=test", "--format=pointodyssey"});
  ASSERT_THAT(recorded, IsOk());
  EXPECT_EQ(recorded->validation_data.split, "val");
  EXPECT_FALSE(recorded->validation_data.augment);
}

TEST(TrainFlagsTest, NamesTheFlagThatIsWrong) {
  const struct {
    std::vector<std::string> args;
    const char* message;
  } kWrong[] = {{{"--preset=huge"}, "--preset"},
                {{"--preset=small"}, "time budget"},
                {{"--preset=test", "--loss=mine"}, "--loss"},
                {{"--preset=test", "--phases=1:64"}, "--phases"},
                {{"--preset=test", "--device=abacus"}, "--device"},
                {{"--preset=test", "--validation_clips=-1"}, "--validation_clips"},
                {{"--preset=test", "--streaming_windows=2"}, "streaming"},
                {{"--preset=test", "--ema=1"}, "--ema"},
                {{"--preset=test", "--lr=0"}, "--lr"}};
  for (const auto& wrong : kWrong) {
    EXPECT_THAT(Request(wrong.args), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(wrong.message)));
  }
}

}  // namespace
}  // namespace holdfast
