// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/report/console.h"
#include "training/report/log_files.h"
#include "training/report/metrics_port.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

StepReport Step(int64_t step) {
  StepReport report;
  report.step = step;
  report.steps = 100;
  report.progress = static_cast<double>(step) / 100;
  report.when = absl::FromUnixSeconds(1000);
  report.elapsed = absl::Seconds(step);
  report.learning_rate = 0.25;
  report.gradient_norm = 2;
  report.clips = 4;
  report.loss = {1.5, 1.25, std::nan(""), 0.5, std::nan("")};
  report.times.data = absl::Milliseconds(250);
  report.times.backward = absl::Milliseconds(750);
  return report;
}

ValidationReport Validation() {
  ValidationReport report;
  report.step = 7;
  report.metrics.delta_vis = 33.5;
  report.best = true;
  return report;
}

std::string Read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(JsonLogTest, WritesALineAnEventAndLeavesOutWhatIsNotThere) {
  const TempDir dir;
  auto log = OpenJsonLog(dir.File("log.jsonl"));
  ASSERT_THAT(log, IsOk());
  (*log)->StepDone(Step(3));
  (*log)->Validated(Validation());
  (*log)->Notice("quoted \"text\"\n");
  std::istringstream lines(Read(dir.File("log.jsonl")));
  std::string line;
  std::getline(lines, line);
  const auto step = nlohmann::json::parse(line);
  EXPECT_EQ(step["step"], 3);
  EXPECT_EQ(step["loss"], 1.5);
  EXPECT_EQ(step["seconds"]["data"], 0.25);
  EXPECT_EQ(step["seconds"]["total"], 1.0);
  EXPECT_FALSE(step.contains("objectness"));
  std::getline(lines, line);
  EXPECT_EQ(nlohmann::json::parse(line)["delta_vis"], 33.5);
  std::getline(lines, line);
  EXPECT_EQ(nlohmann::json::parse(line)["text"], "quoted \"text\"\n");
}

TEST(JsonLogTest, GoesOnWhereAnEarlierRunStopped) {
  const TempDir dir;
  for (int run = 0; run < 2; ++run) (*OpenJsonLog(dir.File("log.jsonl")))->StepDone(Step(1));
  const std::string text = Read(dir.File("log.jsonl"));
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 2);
}

TEST(JsonLogTest, SurvivesAFullDisk) {
  auto log = OpenJsonLog("/dev/full");
  ASSERT_THAT(log, IsOk());
  testing::internal::CaptureStderr();
  (*log)->StepDone(Step(1));
  (*log)->StepDone(Step(2));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "cannot write to /dev/full: lines are missing there\n");
}

TEST(JsonLogTest, ADirectoryThatIsNotThereIsAnError) {
  EXPECT_THAT(OpenJsonLog("/nonexistent/log.jsonl"), StatusIs(absl::StatusCode::kPermissionDenied));
}

TEST(EventLogTest, MakesItsDirectoryAndOneRecordAnEvent) {
  const TempDir dir;
  auto log = OpenEventLog(dir.File("events"), absl::FromUnixSeconds(1000));
  ASSERT_THAT(log, IsOk());
  (*log)->StepDone(Step(3));
  (*log)->Validated(Validation());
  const auto file = std::filesystem::directory_iterator(dir.File("events"))->path();
  EXPECT_THAT(file.filename().string(), StartsWith("events.out.tfevents.1000."));
  const std::string bytes = Read(file.string());
  EXPECT_THAT(bytes, HasSubstr("brain.Event:2"));
  EXPECT_THAT(bytes, HasSubstr("loss/total"));
  EXPECT_THAT(bytes, HasSubstr("validation/delta_vis"));
  EXPECT_THAT(bytes, Not(HasSubstr("loss/objectness")));
}

TEST(ConsoleTest, WritesPlainLinesNowAndThen) {
  std::ostringstream out;
  const auto console = MakeConsole(out, {false, 10});
  for (int step = 1; step <= 11; ++step) console->StepDone(Step(step));
  EXPECT_THAT(out.str(), StartsWith("step 1/100  loss 1.500 (distance 1.250, visible 0.500)"));
  EXPECT_THAT(out.str(), HasSubstr("\nstep 10/100 "));
  EXPECT_THAT(out.str(), Not(HasSubstr("step 11/100")));
  EXPECT_THAT(out.str(), HasSubstr("1.00 s/step, data 25%, 1m30s left"));
}

TEST(ConsoleTest, ATerminalGetsABarThatNoticesDoNotBreak) {
  std::ostringstream out;
  const auto console = MakeConsole(out, {true, 10});
  console->StepDone(Step(50));
  EXPECT_THAT(out.str(), StartsWith("\r\033[K[##########..........] step 50/100"));
  console->Validated(Validation());
  EXPECT_THAT(out.str(), HasSubstr("\r\033[Kvalidation at step 7:  d_vis 33.5  (best)\n"));
}

TEST(ConsoleTest, BarsStayInTheirWidth) {
  EXPECT_EQ(ProgressBar(0, 4), "[....]");
  EXPECT_EQ(ProgressBar(0.5, 4), "[##..]");
  EXPECT_EQ(ProgressBar(7, 4), "[####]");
}

TEST(TrainingMetricsTest, CountsStepsAndShowsTheLastValues) {
  auto metrics = TrainingMetrics::Listen("127.0.0.1:0");
  ASSERT_THAT(metrics, IsOk());
  EXPECT_GT((*metrics)->port(), 0);
  (*metrics)->StepDone(Step(41));
  StepReport skipped = Step(42);
  skipped.skipped = true;
  (*metrics)->StepDone(skipped);
  (*metrics)->Validated(Validation());
  const std::string text = (*metrics)->Text();
  for (const char* line :
       {"holdfast_training_steps_total 2\n", "holdfast_training_skipped_steps_total 1\n", "holdfast_training_step 42\n",
        "holdfast_training_clips_total 8\n", "holdfast_training_data_wait_seconds_total 0.5\n",
        "holdfast_training_loss{part=\"total\"} 1.5\n", "holdfast_training_validation{metric=\"delta_vis\"} 33.5\n"}) {
    EXPECT_THAT(text, HasSubstr(line));
  }
  EXPECT_THAT(text, Not(HasSubstr("objectness")));
}

TEST(TrainingMetricsTest, AnAddressThatIsTakenIsAnError) {
  auto first = TrainingMetrics::Listen("127.0.0.1:0");
  ASSERT_THAT(first, IsOk());
  EXPECT_THAT(TrainingMetrics::Listen("127.0.0.1:" + std::to_string((*first)->port())),
              StatusIs(absl::StatusCode::kUnavailable));
}

}  // namespace
}  // namespace holdfast
