// SPDX-License-Identifier: Apache-2.0
#include "training/validation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <string>
#include <utility>
#include <vector>

#include "tests/support/networks.h"
#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Leaves every point where it starts and gives this logit for its visibility: all weights are 0, and so is what the
// last layer adds.
PointModel StandingStill(float visibility_logit) {
  PointModel model(TinyOptions());
  const torch::NoGradGuard no_grad;
  for (torch::Tensor& parameter : model->parameters()) parameter.zero_();
  model->named_parameters()["delta_block.dense.bias"][2] = visibility_logit;
  return model;
}

// 8 frames of 64 x 64 in which one point stands still and one moves 0.75 px a frame: 3 px of a 256 x 256 frame.
Sample TwoPoints() {
  Sample clip = MovingTexture(8, {64, 64}, {0, 0}, {{20, 20}, {40, 30}});
  for (int64_t s = 0; s < 8; ++s) clip.SetPosition(s, 1, {40 + 0.75f * static_cast<float>(s), 30});
  return clip;
}

Metrics Measure(std::vector<absl::StatusOr<Sample>> samples, PointModel model) {
  const auto validation = Validation::Create(ListDataset(std::move(samples)), 8, 1, 2);
  EXPECT_THAT(validation, IsOk());
  const auto metrics = validation->Run(*model, torch::kCPU);
  EXPECT_THAT(metrics, IsOk());
  return *metrics;
}

// Frames 1 to 7 are wrong by nothing, and by 3, 6, .. 21 px.
TEST(ValidationTest, ScoresInPixelsOfTheFrameWithoutTheQuery) {
  const Metrics metrics = Measure({TwoPoints()}, StandingStill(1));
  EXPECT_NEAR(*metrics.delta_avg, 100.0 * (7 + 7 + 8 + 9 + 12) / (5 * 14), 1e-3);  // of 14 pairs below 1, 2, .. 16 px
  EXPECT_NEAR(*metrics.mte, (0.0 + 12.0) / 2, 1e-3);
  EXPECT_FALSE(metrics.delta_occ.has_value());
}

TEST(ValidationTest, APositiveLogitSaysVisible) {
  Sample clip = TwoPoints();
  for (int64_t s = 4; s < 8; ++s) clip.visible[clip.At(s, 1)] = 0;
  EXPECT_NEAR(*Measure({clip}, StandingStill(1)).oa, 100.0 * 10 / 14, 1e-3);
  EXPECT_NEAR(*Measure({clip}, StandingStill(-1)).oa, 100.0 * 4 / 14, 1e-3);
}

TEST(ValidationTest, FramesWithoutTruthCountNowhere) {
  Sample clip = TwoPoints();
  for (int64_t s = 1; s < 8; ++s) clip.valid[clip.At(s, 1)] = clip.visible[clip.At(s, 1)] = 0;
  EXPECT_NEAR(*Measure({clip}, StandingStill(1)).delta_avg, 100, 1e-3);
}

TEST(ValidationTest, ClipsCountAlike) {
  Sample still = MovingTexture(8, {64, 64}, {0, 0}, {{20, 20}, {24, 20}, {28, 20}, {32, 20}});
  EXPECT_NEAR(*Measure({TwoPoints(), still}, StandingStill(1)).mte, (6.0 + 0.0) / 2, 1e-3) << "of 2 and of 4 points";
}

// Clip i is a point that stands still; what was asked for, and by which chance, is told.
class WatchedClips final : public Dataset {
 public:
  explicit WatchedClips(std::vector<absl::Status> faults) : faults_(std::move(faults)) {}
  size_t size() const override { return faults_.size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override {
    asked.push_back(index);
    chances.push_back(rng.Next());
    if (!faults_[index].ok()) return faults_[index];
    Sample clip = MovingTexture(8, {64, 64}, {0, 0}, {{20, 20}});
    if (index == 1) clip.SelectPoints({});
    return clip;
  }
  mutable std::vector<size_t> asked;
  mutable std::vector<uint64_t> chances;

 private:
  const std::vector<absl::Status> faults_;
};

TEST(ValidationTest, TheFirstClipsThatCanBeUsedAreReadOnce) {
  const WatchedClips clips({absl::DataLossError("broken"), {}, {}, {}, {}});  // the second one has no points
  const auto validation = Validation::Create(clips, 2, 5, 1);
  ASSERT_THAT(validation, IsOk());
  EXPECT_THAT(clips.asked, ElementsAre(0, 1, 2, 3));
  ASSERT_THAT(validation->Run(*StandingStill(1), torch::kCPU), IsOk());
  EXPECT_THAT(clips.asked, ElementsAre(0, 1, 2, 3)) << "they stay in memory";
}

TEST(ValidationTest, TheSeedAndTheClipsNumberAreAllChanceThereIs) {
  const WatchedClips first({{}, {}, {}}), again({{}, {}, {}}), damaged({absl::DataLossError("broken"), {}, {}});
  const WatchedClips other({{}, {}, {}});
  for (const WatchedClips* clips : {&first, &again, &damaged}) {
    ASSERT_THAT(Validation::Create(*clips, 8, 5, 1), IsOk());
    EXPECT_EQ(clips->chances, first.chances);
  }
  ASSERT_THAT(Validation::Create(other, 8, 6, 1), IsOk());
  EXPECT_NE(other.chances, first.chances);
}

TEST(ValidationTest, WithoutAnyClipTheLastReasonIsTold) {
  EXPECT_THAT(Validation::Create(WatchedClips({}), 2, 5, 1),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("empty")));
  EXPECT_THAT(Validation::Create(WatchedClips({absl::NotFoundError("a"), {}, absl::DataLossError("b")}), 2, 5, 1),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("b")));
}

class EndlesslyDamaged final : public Dataset {
 public:
  size_t size() const override { return size_t{1} << 62; }
  absl::StatusOr<Sample> Get(size_t, Rng&) const override { return absl::DataLossError("damaged"); }
};

TEST(ValidationTest, ADataSetWithoutEndOfDamagedClipsIsGivenUp) {
  EXPECT_THAT(Validation::Create(EndlesslyDamaged(), 8, 1, 2), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(ValidationTest, AClipThatTheNetworkCannotTakeIsAnError) {
  Sample odd = MovingTexture(8, {60, 64}, {0, 0}, {{20, 20}});
  const auto validation = Validation::Create(ListDataset({odd}), 1, 5, 1);
  ASSERT_THAT(validation, IsOk());
  EXPECT_THAT(validation->Run(*StandingStill(1), torch::kCPU),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("multiples of 8")));
}

}  // namespace
}  // namespace holdfast
