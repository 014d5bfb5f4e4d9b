// SPDX-License-Identifier: Apache-2.0
#include "training/training_checkpoint.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <torch/types.h>

#include <filesystem>
#include <fstream>

#include "model/checkpoint/checkpoint.h"
#include "model/presets.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

const absl::Time kTime = absl::FromUnixSeconds(1000);

PointModel Network() { return PointModel(*PresetByName("test")); }

TrainingState StateAt(int64_t step) {
  TrainingState state;
  state.step = step;
  state.next_draw = 3 * step;
  state.world = 2;
  state.seed = 0xFFFFFFFFFFFFFFFFull;
  state.elapsed = absl::Milliseconds(1500);
  state.skipped_steps = 2;
  state.best = 41.5;
  state.recipe = "a \"recipe\"";
  state.optimizer = std::string("\0bytes\xff", 7);
  state.average = {{"a.weight", torch::tensor({1.0f, 2.0f})}};
  state.average_updates = 9;
  return state;
}

// As SaveTrainingCheckpoint where no file may have more bytes than 'bytes'.
absl::Status SaveWithin(rlim_t bytes, const TempDir& dir, const TrainingState& state, absl::Time now) {
  rlimit before;
  if (getrlimit(RLIMIT_FSIZE, &before) != 0) return absl::InternalError("getrlimit");
  const auto handler = signal(SIGXFSZ, SIG_IGN);
  const rlimit within = {bytes, before.rlim_max};
  absl::Status status = absl::InternalError("setrlimit");
  if (setrlimit(RLIMIT_FSIZE, &within) == 0) status = SaveTrainingCheckpoint(dir.path(), *Network(), state, now);
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, handler);
  return status;
}

std::string Weights(int64_t step) { return "checkpoint-0000000" + std::to_string(step) + ".safetensors"; }
std::string State(int64_t step) { return "checkpoint-0000000" + std::to_string(step) + ".state.safetensors"; }

TEST(TrainingCheckpointTest, GivesBackWhatWasSaved) {
  const TempDir dir;
  PointModel network = Network();
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *network, StateAt(5), kTime), IsOk());
  const auto found = FindTrainingCheckpoint(dir.path());
  ASSERT_THAT(found, IsOk());
  ASSERT_TRUE(found->has_value());
  const TrainingState& state = (*found)->state;
  EXPECT_EQ(state.step, 5);
  EXPECT_EQ(state.next_draw, 15);
  EXPECT_EQ(state.world, 2);
  EXPECT_EQ(state.seed, 0xFFFFFFFFFFFFFFFFull);
  EXPECT_EQ(state.elapsed, absl::Milliseconds(1500));
  EXPECT_EQ(state.skipped_steps, 2);
  EXPECT_EQ(state.best, 41.5);
  EXPECT_EQ(state.recipe, "a \"recipe\"");
  EXPECT_EQ(state.optimizer, std::string("\0bytes\xff", 7));
  EXPECT_TRUE(torch::equal(state.average.at("a.weight"), torch::tensor({1.0f, 2.0f})));
  EXPECT_EQ(state.average_updates, 9);
  PointModel other = Network();
  ASSERT_THAT(CopyParameters((*found)->weights, *other), IsOk());
  for (const auto& item : network->named_parameters()) {
    EXPECT_TRUE(torch::equal(item.value(), other->named_parameters()[item.key()])) << item.key();
  }
}

TEST(TrainingCheckpointTest, TheWeightsLoadAsAnyNetworksDo) {
  const TempDir dir;
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(5), kTime), IsOk());
  EXPECT_THAT(LoadModel(dir.File(Weights(5))), IsOk());
}

TEST(TrainingCheckpointTest, AnEmptyOrAbsentDirectoryHasNone) {
  const TempDir dir;
  EXPECT_FALSE(FindTrainingCheckpoint(dir.path())->has_value());
  EXPECT_FALSE(FindTrainingCheckpoint(dir.File("absent"))->has_value());
}

TEST(TrainingCheckpointTest, AFirstPairThatWasCutOffIsNone) {
  const TempDir dir;
  const PointModel model = Network();
  ASSERT_THAT(SaveModel(dir.File(Weights(5)), *model), IsOk());
  EXPECT_FALSE(HasTrainingCheckpoint(dir.path()));
  const auto found = FindTrainingCheckpoint(dir.path());
  ASSERT_THAT(found, IsOk());
  EXPECT_FALSE(found->has_value());
  ASSERT_THAT(SaveModel(dir.File(Weights(9)), *model), IsOk());
  EXPECT_TRUE(HasTrainingCheckpoint(dir.path()));
  EXPECT_THAT(FindTrainingCheckpoint(dir.path()), StatusIs(absl::StatusCode::kDataLoss)) << "no cut could do that";
}

TEST(TrainingCheckpointTest, KeepsTheNewestTwo) {
  const TempDir dir;
  for (const int64_t step : {1, 2, 3}) {
    ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(step), kTime), IsOk());
  }
  EXPECT_EQ(dir.Count(), 4u);
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.step, 3);
}

TEST(TrainingCheckpointTest, HalvesOfNewerPairsDoNotCountAsPairs) {
  const TempDir dir;
  for (const int64_t step : {1, 2}) {
    ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(step), kTime), IsOk());
  }
  // As left by processes killed between the two files; the third one goes on from step 2.
  for (const int64_t step : {8, 9}) std::filesystem::copy_file(dir.File(Weights(2)), dir.File(Weights(step)));
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(3), kTime), IsOk());
  EXPECT_EQ(dir.Count(), 4u);
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.step, 3);
  std::filesystem::remove(dir.File(State(3)));
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.step, 2) << "the pair before stays too";
}

TEST(TrainingCheckpointTest, APairWithoutItsSecondFileIsPassedOver) {
  const TempDir dir;
  for (const int64_t step : {1, 2}) {
    ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(step), kTime), IsOk());
  }
  // As left by a process killed between the two files, and in the middle of the second.
  std::filesystem::remove(dir.File(State(2)));
  std::ofstream(dir.File(State(2) + ".tmp.1234")) << "half a file";
  const auto found = FindTrainingCheckpoint(dir.path());
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ((*found)->state.step, 1);
  EXPECT_THAT((*found)->skipped, HasSubstr("step 2"));
}

TEST(TrainingCheckpointTest, FilesOfDifferentPairsAreNoPair) {
  const TempDir dir, other;
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(4), kTime), IsOk());
  ASSERT_THAT(SaveTrainingCheckpoint(other.path(), *Network(), StateAt(4), kTime + absl::Seconds(1)), IsOk());
  std::filesystem::copy_file(other.File(State(4)), dir.File(State(4)),
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_THAT(FindTrainingCheckpoint(dir.path()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("belong together")));
}

TEST(TrainingCheckpointTest, DamagedFilesAreAnErrorAndNoFreshStart) {
  const TempDir dir;
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(4), kTime), IsOk());
  std::filesystem::resize_file(dir.File(State(4)), 100);
  EXPECT_THAT(FindTrainingCheckpoint(dir.path()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("step 4")));
}

TEST(TrainingCheckpointTest, AFullDiskLeavesTheLastCheckpointWhole) {
  const TempDir dir;
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(1), kTime), IsOk());
  EXPECT_FALSE(SaveWithin(4096, dir, StateAt(2), kTime).ok());
  EXPECT_EQ(dir.Count(), 2u) << "the half-written file is gone";
  const auto found = FindTrainingCheckpoint(dir.path());
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ((*found)->state.step, 1);
}

TEST(TrainingCheckpointTest, SavingAStepAgainKeepsItsPairThoughTheDiskIsFull) {
  const TempDir dir;
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(4), kTime), IsOk());
  const auto weights = static_cast<rlim_t>(std::filesystem::file_size(dir.File(Weights(4))));
  TrainingState large = StateAt(4);
  large.optimizer.assign(2 * weights, 'x');
  SaveWithin(weights, dir, large, kTime + absl::Seconds(1)).IgnoreError();  // there is room for the weights alone
  const auto found = FindTrainingCheckpoint(dir.path());
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ((*found)->state.step, 4);
  EXPECT_EQ((*found)->state.optimizer, StateAt(4).optimizer);
}

TEST(TrainingCheckpointTest, SavingAStepAgainReplacesAPairThatIsDamaged) {
  const TempDir dir;
  for (const int64_t step : {3, 4}) {
    ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(step), kTime), IsOk());
  }
  std::filesystem::resize_file(dir.File(State(4)), 100);
  ASSERT_THAT(SaveTrainingCheckpoint(dir.path(), *Network(), StateAt(4), kTime + absl::Seconds(1)), IsOk());
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.step, 4);
}

}  // namespace
}  // namespace holdfast
