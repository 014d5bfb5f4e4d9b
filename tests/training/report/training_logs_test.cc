// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
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

// While it lives the process's files take 'bytes' and no more.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit full = {bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &full);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, handler_);
  }

 private:
  const sighandler_t handler_;
  rlimit before_;
};

// Steps 1 to 6, of which 3 and 4 find room for a part of a record.
void LogStepsThroughAFullDisk(TrainingObserver& log, const std::string& path) {
  for (int step = 1; step <= 2; ++step) log.StepDone(Step(step));
  {
    const FullDisk full(std::filesystem::file_size(path) + 20);
    testing::internal::CaptureStderr();
    for (int step = 3; step <= 4; ++step) log.StepDone(Step(step));
    EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("lines are missing there"));
  }
  for (int step = 5; step <= 6; ++step) log.StepDone(Step(step));
}

TEST(JsonLogTest, LinesAreWholeOrMissing) {
  const TempDir dir;
  auto log = OpenJsonLog(dir.File("log.jsonl"));
  ASSERT_THAT(log, IsOk());
  LogStepsThroughAFullDisk(**log, dir.File("log.jsonl"));
  std::istringstream lines(Read(dir.File("log.jsonl")));
  std::vector<int> steps;
  for (std::string line; std::getline(lines, line);) steps.push_back(nlohmann::json::parse(line)["step"]);
  EXPECT_EQ(steps, (std::vector<int>{1, 2, 5, 6}));
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

TEST(EventLogTest, RecordsAreWholeOrMissing) {
  const TempDir dir;
  auto log = OpenEventLog(dir.path(), absl::FromUnixSeconds(1000));
  ASSERT_THAT(log, IsOk());
  const std::string path = std::filesystem::directory_iterator(dir.path())->path();
  LogStepsThroughAFullDisk(**log, path);
  const std::string bytes = Read(path);
  size_t records = 0, at = 0;
  for (; at + 8 <= bytes.size(); ++records) {
    uint64_t length;
    std::memcpy(&length, bytes.data() + at, sizeof length);
    at += 8 + 4 + length + 4;
  }
  EXPECT_EQ(at, bytes.size());
  EXPECT_EQ(records, 5u) << "the version and four steps";
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

TEST(ConsoleTest, SaysHowManySamplesAreDamaged) {
  std::ostringstream out;
  const auto console = MakeConsole(out, {false, 1});
  StepReport report = Step(1);
  console->StepDone(report);
  EXPECT_THAT(out.str(), Not(HasSubstr("damaged")));
  report.skipped_samples = 3;
  console->StepDone(report);
  EXPECT_THAT(out.str(), HasSubstr("  3 damaged samples skipped\n"));
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

template <typename... Fields>
constexpr size_t Count(const Fields&...) {
  return sizeof...(Fields);
}

TEST(LossColumnsTest, EveryPartHasAColumnOfItsOwn) {
  // A part more or less than these does not compile: it needs a row of kLossColumns.
  const auto& [total, distance, objectness, visibility, matching] = LossValues{};
  EXPECT_EQ(kLossColumns.size(), Count(total, distance, objectness, visibility, matching));
  LossValues values = {};
  std::set<std::string> names, keys, labels;
  for (const LossColumn& column : kLossColumns) {
    EXPECT_EQ(values.*column.value, 0) << column.name << " is the part of another column too";
    values.*column.value = 1;
    names.insert(column.name);
    keys.insert(column.key);
    labels.insert(column.label);
  }
  for (const auto& distinct : {names, keys, labels}) EXPECT_EQ(distinct.size(), kLossColumns.size());
}

TEST(LossColumnsTest, EachReachesEveryRecord) {
  StepReport report = Step(3);
  for (size_t i = 0; i < kLossColumns.size(); ++i) report.loss.*kLossColumns[i].value = 2.5 + static_cast<double>(i);
  const TempDir dir;
  std::ostringstream console;
  auto json = OpenJsonLog(dir.File("log.jsonl"));
  auto events = OpenEventLog(dir.File("events"), absl::FromUnixSeconds(1000));
  auto metrics = TrainingMetrics::Listen("127.0.0.1:0");
  ASSERT_THAT(json, IsOk());
  ASSERT_THAT(events, IsOk());
  ASSERT_THAT(metrics, IsOk());
  MakeConsole(console, {false, 1})->StepDone(report);
  (*json)->StepDone(report);
  (*events)->StepDone(report);
  (*metrics)->StepDone(report);
  EXPECT_THAT(console.str(), HasSubstr("  loss 2.500 (distance 3.500, object 4.500, visible 5.500, match 6.500)  lr "));
  const auto line = nlohmann::json::parse(Read(dir.File("log.jsonl")));
  const std::string bytes = Read(std::filesystem::directory_iterator(dir.File("events"))->path().string());
  for (const LossColumn& column : kLossColumns) {
    const double value = report.loss.*column.value;
    EXPECT_EQ(line[column.key], value);
    EXPECT_THAT(bytes, HasSubstr(absl::StrCat("loss/", column.name)));
    EXPECT_THAT((*metrics)->Text(),
                HasSubstr(absl::StrCat("holdfast_training_loss{part=\"", column.name, "\"} ", value, "\n")));
  }
}

TEST(LossColumnsTest, ALossThatIsNotFiniteShowsOnTheConsole) {
  StepReport report = Step(1);
  report.loss.total = report.loss.distance = std::nan("");
  std::ostringstream out;
  MakeConsole(out, {false, 1})->StepDone(report);
  EXPECT_THAT(out.str(), HasSubstr("loss nan (distance nan, visible 0.500)"));
}

TEST(TrainingMetricsTest, AnAddressThatIsTakenIsAnError) {
  auto first = TrainingMetrics::Listen("127.0.0.1:0");
  ASSERT_THAT(first, IsOk());
  EXPECT_THAT(TrainingMetrics::Listen("127.0.0.1:" + std::to_string((*first)->port())),
              StatusIs(absl::StatusCode::kUnavailable));
}

}  // namespace
}  // namespace holdfast
