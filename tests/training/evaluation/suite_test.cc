// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/suite.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class SuiteTest : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = std::filesystem::path(::testing::TempDir()) / ("suite" + std::to_string(getpid()));
    std::filesystem::remove_all(root_);
    std::filesystem::create_directories(root_);
  }
  void TearDown() override { std::filesystem::remove_all(root_); }

  std::filesystem::path root_;
};

std::vector<Report> Ours(double delta) {
  Report report;
  report.method = "holdfast small (weights abc)";
  report.sequences.resize(1);
  report.sequences[0].processing_size = {896, 512};
  report.mean.delta_avg = delta;
  return {report};
}

TEST_F(SuiteTest, KnowsThePapersFigures) {
  const std::vector<PublishedResult> results = PaperResults();
  ASSERT_EQ(results.size(), 3u);
  EXPECT_EQ(results[0].published.delta_occ, 23.7);
  EXPECT_EQ(results[0].points, 256);
  EXPECT_EQ(results[1].published.survival_50, 94.6);
  EXPECT_EQ(results[1].points, 0) << "all of them";
  EXPECT_EQ(results[2].published.mte, 13.5);
  EXPECT_EQ(results[2].processing_size, (ImageSize{1280, 768}));
}

TEST_F(SuiteTest, EvaluatesTheDataSetsThatArePresentAndNamesTheOthers) {
  std::filesystem::create_directory(root_ / "tapvid_davis");
  std::vector<std::string> evaluated;
  const std::vector<SuiteRow> rows =
      RunSuite(PaperResults(), root_.string(), [&](const PublishedResult& published, const std::string& folder) {
        evaluated.push_back(folder);
        EXPECT_EQ(published.format, "tapvid");
        return Ours(12.5);
      });
  EXPECT_EQ(evaluated, std::vector<std::string>{(root_ / "tapvid_davis").string()});
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_THAT(rows[0].ours, StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(rows[1].ours, IsOk());
}

TEST_F(SuiteTest, ShowsTheMethodsFiguresUnderThePapers) {
  const std::string table =
      FormatSuite({{PaperResults()[1], Ours(12.5)}, {PaperResults()[2], absl::NotFoundError("absent: get it")}});
  EXPECT_THAT(table,
              HasSubstr("TAP-Vid-DAVIS     paper    896x512   69.5      -      -    94.6       -   4.8   -   -     -\n"
                        "               holdfast    896x512   12.5"));
  EXPECT_THAT(table, HasSubstr("\nCroHD: absent: get it\n"));
  EXPECT_THAT(FormatSuite({{PaperResults()[2], Ours(12.5)}}), HasSubstr("\nCroHD: heads by the motion"));
}

TEST_F(SuiteTest, SaysHowManySequencesWereSkipped) {
  std::vector<Report> reports = Ours(1);
  EXPECT_THAT(FormatSuite({{PaperResults()[0], reports}}), Not(HasSubstr("skipped")));
  reports[0].skipped.resize(2);
  EXPECT_THAT(FormatSuite({{PaperResults()[0], reports}}), HasSubstr("PointOdyssey (test): 2 sequences skipped"));
}

}  // namespace
}  // namespace holdfast
