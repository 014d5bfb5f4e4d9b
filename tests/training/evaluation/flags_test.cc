// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/flags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/flags/reflection.h"
#include "program/flags.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

class EvaluateFlagsTest : public ::testing::Test {
 protected:
  absl::StatusOr<EvaluateRequest> Request(const std::vector<std::string>& args) {
    EXPECT_THAT(ParseFlags(args), IsOk());
    return RequestFromFlags();
  }

 private:
  const absl::FlagSaver restored_at_the_end_;
};

TEST_F(EvaluateFlagsTest, DefaultsFollowTheEngine) {
  const auto request = Request({"--weights=w.safetensors"});
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->methods.engine.weights_path, "w.safetensors");
  EXPECT_EQ(request->methods.engine.iterations, EngineOptions().iterations);
  EXPECT_EQ(request->methods.engine.hop_frames, EngineOptions().hop_frames);
  EXPECT_TRUE(request->methods.engine.motion_prior);
  EXPECT_TRUE(request->methods.engine.polish);
  EXPECT_FALSE(request->methods.lucas_kanade);
  EXPECT_TRUE(request->processing_size.empty());
  EXPECT_THAT(request->methods.engine.Validate(), IsOk());
}

TEST_F(EvaluateFlagsTest, OpticalFlowCanBeSwitchedOff) {
  const auto request = Request({"--weights=w", "--motion_prior=false", "--polish=false"});
  ASSERT_THAT(request, IsOk());
  EXPECT_FALSE(request->methods.engine.motion_prior);
  EXPECT_FALSE(request->methods.engine.polish);
}

TEST_F(EvaluateFlagsTest, PublishedChainingHopsAWholeWindow) {
  const auto request = Request({"--weights=w", "--chaining=published"});
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->methods.engine.chaining, Chaining::kPublished);
  EXPECT_EQ(request->methods.engine.hop_frames, 23);
}

TEST_F(EvaluateFlagsTest, TheSuiteIteratesAsThePublishedTestsDo) {
  EXPECT_EQ(Request({"--weights=w", "--suite=paper", "--data=d"})->methods.engine.iterations, 16);
  EXPECT_EQ(Request({"--weights=w", "--suite=paper", "--data=d"})->methods.engine.least_step, 0);
  EXPECT_EQ(Request({"--weights=w", "--suite=paper", "--data=d", "--iterations=6"})->methods.engine.iterations, 6);
}

TEST_F(EvaluateFlagsTest, ReadsSizesAndChoices) {
  const auto request =
      Request({"--baseline=lk", "--processing_size=640x480", "--precision=bfloat16", "--count=7", "--least_step=0.75"});
  ASSERT_THAT(request, IsOk());
  EXPECT_TRUE(request->methods.lucas_kanade);
  EXPECT_EQ(request->processing_size, (ImageSize{640, 480}));
  EXPECT_EQ(request->methods.engine.precision, Precision::kBFloat16);
  EXPECT_EQ(request->methods.engine.least_step, 0.75);
  EXPECT_EQ(request->data.count, 7u);
}

TEST_F(EvaluateFlagsTest, CalibratesWhenToldWhere) {
  const auto without = Request({"--weights=w"});
  ASSERT_THAT(without, IsOk());
  EXPECT_EQ(without->calibrate, "");
  EXPECT_FALSE(without->methods.calibrate);
  const auto with = Request({"--weights=w", "--calibrate=to.safetensors"});
  ASSERT_THAT(with, IsOk());
  EXPECT_EQ(with->calibrate, "to.safetensors");
  EXPECT_TRUE(with->methods.calibrate);
  EXPECT_EQ(with->methods.engine.weights_path, "w");
}

TEST_F(EvaluateFlagsTest, CalibratesNothingWithoutWeights) {
  EXPECT_THAT(Request({"--calibrate=to.safetensors", "--baseline=lk"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--calibrate: needs --weights")));
}

TEST_F(EvaluateFlagsTest, RefusesWhatItDoesNotKnowByTheFlagsName) {
  EXPECT_THAT(ParseFlags({"--processing_size=640"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--processing_size")));
  EXPECT_THAT(Request({"--processing_size=", "--baseline=raft"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--baseline: expected one of , lk")));
  EXPECT_THAT(Request({"--baseline=", "--suite=kinetics"}), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(Request({"--suite=paper"}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--data")));
  EXPECT_THAT(Request({"--suite=", "--count=-1"}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--count")));
}

TEST_F(EvaluateFlagsTest, SettingsAreTheFlagsThatWereChanged) {
  ASSERT_THAT(ParseFlags({"--count=7", "--baseline=lk"}), IsOk());
  EXPECT_THAT(SettingsFromFlags(), ElementsAre(Pair("baseline", "lk"), Pair("count", "7")));
}

}  // namespace
}  // namespace holdfast
