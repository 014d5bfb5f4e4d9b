// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/data_sets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"
#include "training/data/readers/neutral.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

class EvaluationDataTest : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = std::filesystem::path(::testing::TempDir()) / ("evaluation_data" + std::to_string(getpid()));
    for (const char* name : {"a", "b", "c"}) {
      const Sample clip = MovingTexture(6, {64, 48}, {1, 0}, {{20, 20}, {30, 30}, {40, 20}});
      ASSERT_THAT(WriteNeutral(clip, (root_ / name).string()), IsOk());
    }
  }
  void TearDown() override { std::filesystem::remove_all(root_); }

  EvaluationDataOptions Neutral() const {
    EvaluationDataOptions options;
    options.format = "neutral";
    options.dir = root_.string();
    return options;
  }

  std::filesystem::path root_;
};

absl::StatusOr<Sample> FirstOf(const Dataset& dataset) {
  Rng rng(1);
  return dataset.Get(0, rng);
}

TEST_F(EvaluationDataTest, OpensWholeClipsOfAFolder) {
  const auto dataset = OpenEvaluationData(Neutral());
  ASSERT_THAT(dataset, IsOk());
  EXPECT_EQ((*dataset)->size(), 3u);
  const auto clip = FirstOf(**dataset);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->num_frames(), 6);
  EXPECT_EQ(clip->num_points(), 3);
}

TEST_F(EvaluationDataTest, TakesNoMoreSequencesFramesAndPointsThanAskedFor) {
  EvaluationDataOptions options = Neutral();
  options.count = 2;
  options.frames = 4;
  options.points = 1;
  const auto dataset = OpenEvaluationData(options);
  ASSERT_THAT(dataset, IsOk());
  EXPECT_EQ((*dataset)->size(), 2u);
  const auto clip = FirstOf(**dataset);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->num_frames(), 4);
  EXPECT_EQ(clip->num_points(), 1);
}

TEST_F(EvaluationDataTest, AConvertedTapVidDataSetIsInTheNeutralFormat) {
  EvaluationDataOptions options = Neutral();
  options.format = "tapvid";
  const auto dataset = OpenEvaluationData(options);
  ASSERT_THAT(dataset, IsOk());
  EXPECT_EQ((*dataset)->size(), 3u);
}

TEST_F(EvaluationDataTest, SyntheticClipsAreTheSameForTheSameSeed) {
  EvaluationDataOptions options;
  options.format = "synthetic";
  options.count = 3;
  options.frames = 4;
  options.points = 8;
  options.size = {96, 64};
  options.seed = 5;
  const auto first = OpenEvaluationData(options);
  const auto second = OpenEvaluationData(options);
  options.seed = 6;
  const auto other = OpenEvaluationData(options);
  ASSERT_THAT(first, IsOk());
  EXPECT_EQ((*first)->size(), 3u);
  EXPECT_EQ(FirstOf(**first)->tracks, FirstOf(**second)->tracks);
  EXPECT_NE(FirstOf(**first)->tracks, FirstOf(**other)->tracks);
  EXPECT_EQ(FirstOf(**first)->size(), (ImageSize{96, 64}));
}

TEST_F(EvaluationDataTest, RefusesUnknownFormatsAndMissingDirectories) {
  EvaluationDataOptions options = Neutral();
  options.format = "avi";
  EXPECT_THAT(OpenEvaluationData(options), StatusIs(absl::StatusCode::kInvalidArgument,
                                                    HasSubstr("neutral, pointodyssey, tapvid, crohd, synthetic")));
  for (const std::string& format : EvaluationFormats()) {
    if (format == "synthetic") continue;
    options.format = format;
    options.dir = "";
    EXPECT_THAT(OpenEvaluationData(options), StatusIs(absl::StatusCode::kInvalidArgument)) << format;
    options.dir = (root_ / "nowhere").string();
    EXPECT_THAT(OpenEvaluationData(options), StatusIs(absl::StatusCode::kNotFound)) << format;
  }
}

}  // namespace
}  // namespace holdfast
