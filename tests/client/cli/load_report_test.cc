// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

LoadResult Healthy(int64_t frames) {
  LoadResult result;
  result.sessions = 1;
  result.frames = frames;
  result.active = absl::Seconds(10);
  for (int i = 1; i <= 100; ++i) result.first.Add(absl::Milliseconds(i));
  return result;
}

LoadResult Bad() {
  LoadResult result;
  result.kind = LoadKind::kBad;
  result.sessions = 7;
  result.errors.assign(20, absl::InternalError("what is this"));
  return result;
}

TEST(LoadReportTest, ATableHasALineForEachKindThatThereIs) {
  const std::string table = DescribeLoad({Healthy(100), Healthy(50), Bad()}, absl::Seconds(10));
  EXPECT_THAT(table, ContainsRegex("healthy +2 +2 +0 +0 +15\\.0 +5\\.0  50 / 95 / 99 "));
  EXPECT_THAT(table, ContainsRegex("bad +1 +7 +0 +20 "));
  EXPECT_THAT(table, Not(HasSubstr("slow ")));
  EXPECT_THAT(table, HasSubstr("error: INTERNAL: what is this\n"));
  EXPECT_THAT(table, HasSubstr("and 12 errors more"));
}

TEST(LoadReportTest, JsonHasEveryClientAndTheTotals) {
  const auto json = nlohmann::json::parse(LoadAsJson({Healthy(100), Healthy(50), Bad()}, absl::Seconds(10)));
  EXPECT_EQ(json["seconds"], 10);
  ASSERT_EQ(json["clients"].size(), 3u);
  EXPECT_EQ(json["clients"][1]["frames_per_second"], 5);
  EXPECT_EQ(json["clients"][2]["errors"][0], "INTERNAL: what is this");
  ASSERT_EQ(json["totals"].size(), 2u);
  EXPECT_EQ(json["totals"][0]["kind"], "healthy");
  EXPECT_EQ(json["totals"][0]["frames_per_second"], 15);
  EXPECT_EQ(json["totals"][0]["first_estimate_ms"]["p95"], 95);
}

TEST(LoadReportTest, OnlyHealthyClientsCount) {
  EXPECT_THAT(CheckLoad({Healthy(10), Bad()}), IsOk());
  LoadResult failed = Healthy(10);
  failed.errors.push_back(absl::UnavailableError("gone"));
  EXPECT_THAT(CheckLoad({Healthy(10), failed}),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("1 of 2 healthy clients saw errors")));
  LoadResult refused = Healthy(0);
  refused.sessions = 0;
  EXPECT_THAT(CheckLoad({refused}), StatusIs(absl::StatusCode::kInternal, HasSubstr("no healthy client")));
  EXPECT_THAT(CheckLoad({refused, Healthy(1)}), IsOk()) << "a refusal is no error";
}

}  // namespace
}  // namespace holdfast
