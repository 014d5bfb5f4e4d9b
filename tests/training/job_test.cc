// SPDX-License-Identifier: Apache-2.0
#include "training/job.h"

#include <gtest/gtest.h>

#include <atomic>
#include <opencv2/core/utility.hpp>
#include <string>

#include "model/presets.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

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

absl::Status RunJob(const TrainRequest& request) {
  const std::atomic<bool> stop{false};
  return RunTraining(request, GroupOptions(), stop);
}

TEST(TrainingJobTest, KeepsOpenCvFromThreadsOfItsOwn) {
  const TempDir dir;
  cv::setNumThreads(2);
  ASSERT_THAT(RunJob(OneStep(dir.path())), IsOk());
  EXPECT_EQ(cv::getNumThreads(), 1);
}

}  // namespace
}  // namespace holdfast
