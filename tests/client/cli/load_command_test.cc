// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <utility>

#include "tests/support/fake_tracker.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

LoadOptions Short(const std::string& input) {
  LoadOptions options;
  options.input = input;
  options.sessions = 4;
  options.points = 6;
  options.fps = 200;
  options.duration = absl::Milliseconds(50);
  return options;
}

TEST(LoadOptionsTest, SaysWhatIsWrong) {
  const LoadOptions good = Short("x");
  EXPECT_THAT(good.Validate(), IsOk());
  const auto expect = [&good](const char* text, auto change) {
    LoadOptions options = good;
    change(options);
    EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(text)));
  };
  expect("--sessions", [](LoadOptions& o) { o.sessions = 0; });
  expect("--sessions", [](LoadOptions& o) { o.sessions = 1001; });
  expect("--points", [](LoadOptions& o) { o.points = 0; });
  expect("--fps", [](LoadOptions& o) { o.fps = -1; });
  expect("--seconds", [](LoadOptions& o) { o.duration = absl::ZeroDuration(); });
  expect("--ramp", [](LoadOptions& o) { o.ramp = absl::Milliseconds(51); });
  expect("--ramp", [](LoadOptions& o) { o.ramp = absl::Milliseconds(-1); });
  expect("--slow", [](LoadOptions& o) { o.slow = 101; });
  expect("--bad", [](LoadOptions& o) { o.bad = -1; });
  expect("at most 100 per cent", [](LoadOptions& o) { o.slow = o.cancel = 60; });
  expect("--out", [](LoadOptions& o) { o.out = "load.csv"; });
  expect("--max_side", [](LoadOptions& o) { o.max_side = -5; });
  expect("--jpeg_quality", [](LoadOptions& o) { o.jpeg_quality = 500; });
  expect("--processing_size", [](LoadOptions& o) { o.processing_size = {500, 384}; });
  expect("--promise_fps", [](LoadOptions& o) { o.promise_fps = -3; });
  expect("--promise_fps", [](LoadOptions& o) { o.promise_fps = std::nan(""); });
}

TEST(LoadOptionsTest, SharesBecomeWholeClients) {
  LoadOptions options = Short("x");
  options.sessions = 10;
  options.slow = 20;
  options.cancel = 10;
  options.bad = 14;
  const std::vector<LoadKind> kinds = KindsOf(options);
  const auto count = [&kinds](LoadKind kind) { return std::count(kinds.begin(), kinds.end(), kind); };
  EXPECT_EQ(kinds.size(), 10u);
  EXPECT_EQ(count(LoadKind::kSlow), 2);
  EXPECT_EQ(count(LoadKind::kCancel), 1);
  EXPECT_EQ(count(LoadKind::kBad), 1);
  options.slow = options.cancel = 50;
  options.bad = 0;
  options.sessions = 3;
  EXPECT_EQ(KindsOf(options).size(), 3u);
}

TEST(LoadCommandTest, RunsEachClientOnAConnectionOfItsOwn) {
  const TempDir dir;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(
        cv::imwrite(dir.File("film" + std::to_string(i) + ".png"), cv::Mat(48, 64, CV_8UC3, cv::Scalar(9, 9, 9))));
  }
  std::atomic<int> connections{0};
  StopSignal stop;
  std::ostringstream out;
  LoadOptions options = Short(dir.path().string());
  options.out = dir.File("load.json");
  const auto connect = [&connections]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    ++connections;
    return std::make_unique<FakeTracker>(FakeTracker::Behaviour{[](const PointQuery& query, int64_t, int64_t) {
      return FakeEstimate{query.x, query.y};
    }});
  };
  EXPECT_THAT(RunLoad(options, {connect, stop, out}), IsOk());
  EXPECT_EQ(connections, 4);
  EXPECT_THAT(out.str(), ::testing::ContainsRegex("healthy +4 +4 +0 +0 "));
  EXPECT_TRUE(std::filesystem::exists(options.out));
}

TEST(LoadCommandTest, AnInputThatIsNotThereIsAnError) {
  StopSignal stop;
  std::ostringstream out;
  const auto connect = []() -> absl::StatusOr<std::unique_ptr<PointTracker>> { return absl::InternalError("unused"); };
  EXPECT_FALSE(RunLoad(Short("/nowhere.mp4"), {connect, stop, out}).ok());
}

}  // namespace
}  // namespace holdfast
