// SPDX-License-Identifier: Apache-2.0
#include "training/job.h"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <sstream>
#include <string>

#include "model/checkpoint/checkpoint.h"
#include "model/presets.h"
#include "tests/support/free_port.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TrainRequest OneStep(const std::string& directory) {
  TrainRequest request;
  request.network = *PresetByName("test");
  request.trainer.recipe = *RecipeByName("test");
  request.trainer.recipe.steps = 1;
  request.trainer.directory = directory;
  request.trainer.validate_every = 0;
  request.data.frames = request.trainer.recipe.frames;
  request.threads = 1;
  return request;
}

absl::Status RunJob(const TrainRequest& request, const GroupOptions& options = GroupOptions()) {
  const std::atomic<bool> stop{false};
  return RunTraining(request, options, stop).status();
}

std::string Contents(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TEST(TrainingJobTest, KeepsOpenCvFromThreadsOfItsOwn) {
  const TempDir dir;
  cv::setNumThreads(2);
  ASSERT_THAT(RunJob(OneStep(dir.path())), IsOk());
  EXPECT_EQ(cv::getNumThreads(), 1);
}

TEST(TrainingJobTest, GoesOnWithoutTheWeightsThatItStartedFrom) {
  const TempDir dir;
  TrainRequest request = OneStep(dir.File("out"));
  request.init = dir.File("init.safetensors");
  ASSERT_THAT(SaveModel(request.init, *PointModel(request.network)), IsOk());
  ASSERT_THAT(RunJob(request), IsOk());
  const std::string log = dir.File("out/log.jsonl");
  EXPECT_THAT(Contents(log), HasSubstr("starting from"));
  std::filesystem::remove(request.init);
  std::filesystem::remove(log);
  ASSERT_THAT(RunJob(request), IsOk());
  EXPECT_THAT(Contents(log), HasSubstr("going on from step 1"));
  EXPECT_THAT(Contents(log), Not(HasSubstr("starting from")));
}

TEST(TrainingJobTest, WithoutACheckpointTheWeightsToStartFromMustBeThere) {
  const TempDir dir;
  TrainRequest request = OneStep(dir.File("out"));
  request.init = dir.File("init.safetensors");
  EXPECT_THAT(RunJob(request).message(), HasSubstr("init.safetensors"));
}

TEST(TrainingJobTest, SaysOfAValidationOnlyWhatThereWas) {
  const TempDir dir;
  TrainRequest request = OneStep(dir.path());
  ASSERT_THAT(RunJob(request), IsOk());
  EXPECT_THAT(Contents(dir.File("log.jsonl")), HasSubstr("finished at step 1"));
  EXPECT_THAT(Contents(dir.File("log.jsonl")), Not(HasSubstr("best validation")));
}

TEST(TrainingJobTest, LogsAndMetricsAreThereWhileOtherProcessesAreWaitedFor) {
  const TempDir dir;
  TrainRequest request = OneStep(dir.path());
  request.metrics_address = "127.0.0.1:0";
  GroupOptions alone;  // the first of two processes, the second of which does not come
  alone.world = 2;
  alone.address = "127.0.0.1";
  alone.port = FreePort();
  alone.timeout = absl::Milliseconds(100);
  EXPECT_THAT(RunJob(request, alone), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(Contents(dir.File("log.jsonl")), HasSubstr("metrics on port"));
  EXPECT_THAT(Contents(dir.File("log.jsonl")), HasSubstr("until 2 processes are there"));
}

TEST(TrainingJobTest, AnExceptionBeforeTheFirstStepIsAnError) {
  const TempDir dir;
  TrainRequest request = OneStep(dir.path());
  request.trainer.device = torch::Device("meta");  // its tensors have no numbers
  EXPECT_FALSE(RunJob(request).ok());
}

}  // namespace
}  // namespace holdfast
