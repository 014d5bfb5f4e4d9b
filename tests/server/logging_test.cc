// SPDX-License-Identifier: Apache-2.0
#include "server/logging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "server/port_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using nlohmann::json;

class JsonLogTest : public ::testing::Test {
 protected:
  JsonLogTest() { logger_->set_formatter(MakeJsonFormatter()); }
  json Line() const { return json::parse(out_.str()); }

  std::ostringstream out_;
  std::shared_ptr<spdlog::logger> logger_ =
      std::make_shared<spdlog::logger>("server", std::make_shared<spdlog::sinks::ostream_sink_mt>(out_));
};

TEST_F(JsonLogTest, ALineIsOneObject) {
  logger_->warn("disk is \"full\"\nreally");
  EXPECT_EQ(out_.str().find('\n'), out_.str().size() - 1);
  EXPECT_EQ(Line()["level"], "warning");
  EXPECT_EQ(Line()["message"], "disk is \"full\"\nreally");
  EXPECT_FALSE(Line().contains("session"));
}

TEST_F(JsonLogTest, SessionsLinesCarryIdAndLabel) {
  SessionLogger(*logger_, "s-12", "cam/era 3", {"0123", "45"})->info("opened");
  EXPECT_EQ(Line()["session"], "s-12");
  EXPECT_EQ(Line()["label"], "cam/era 3");
  EXPECT_EQ(Line()["trace_id"], "0123");
  EXPECT_EQ(Line()["span_id"], "45");
}

TEST_F(JsonLogTest, TextShowsSessionAndLabel) {
  logger_->set_formatter(MakeTextFormatter());
  SessionLogger(*logger_, "s-12", "cam/era 3", {"0123", "45"})->info("opened");
  logger_->warn("hot");
  EXPECT_THAT(out_.str(), ::testing::ContainsRegex("info \\[s-12/cam/era 3\\] opened\n.* warning \\[server\\] hot\n$"));
}

TEST_F(JsonLogTest, BytesThatAreNotTextDoNotBreakTheLine) {
  logger_->info(std::string("bad \xff\xfe bytes"));
  EXPECT_EQ(Line()["level"], "info");
}

TEST(MakeLoggerTest, TheLevelHolds) {
  EXPECT_FALSE(MakeLogger(LogFormat::kText, "warning")->should_log(spdlog::level::info));
  EXPECT_TRUE(MakeLogger(LogFormat::kJson, "debug")->should_log(spdlog::level::debug));
}

TEST(PortFileTest, HoldsThePortsThatThereAre) {
  const TempDir dir;
  const std::string path = dir.File("ports");
  ASSERT_THAT(WritePortFile(path, {{"grpc", 1234}, {"metrics", 5678}, {"web", 0}}), IsOk());
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  EXPECT_EQ(text.str(), "grpc=1234\nmetrics=5678\n");
}

TEST(PortFileTest, ADirectoryThatIsNotThereIsAnError) {
  EXPECT_THAT(WritePortFile("/nonexistent/ports", {{"grpc", 1}, {"metrics", 2}, {"web", 0}}),
              StatusIs(absl::StatusCode::kNotFound, ::testing::HasSubstr("/nonexistent/ports")));
}

}  // namespace
}  // namespace holdfast
