// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

SequenceReport Sequence(const std::string& name, ImageSize processing_size, double delta) {
  SequenceReport sequence;
  sequence.name = name;
  sequence.frames = 24;
  sequence.points = 64;
  sequence.frame_size = {320, 256};
  sequence.processing_size = processing_size;
  sequence.seconds = 1.5;
  sequence.metrics.delta_avg = delta;
  return sequence;
}

Report MakeReport() {
  Report report;
  report.method = "holdfast small";
  report.sequences = {Sequence("walk", {512, 384}, 41.25), Sequence("a longer name", {512, 384}, 50)};
  report.skipped = {{"broken", "anno.npz is cut short"}};
  report.mean.delta_avg = 45.625;
  return report;
}

TEST(ReportTest, TheTableHasARowPerSequenceAndTheMean) {
  Report report = MakeReport();
  report.sequences.resize(1);
  EXPECT_EQ(
      FormatReport(report),
      "# holdfast small, processed at 512x384\n"
      "sequence   frames  points   source  processed  seconds  d_avg  d_vis  d_occ  surv50  surv16  MTE  OA  AJ  left\n"
      "walk           24      64  320x256    512x384      1.5   41.2      -      -       -       -    -   -   -     -\n"
      "mean of 1                             512x384      1.5   45.6      -      -       -       -    -   -   -     -\n"
      "skipped broken: anno.npz is cut short\n");
}

Reliability MakeReliability() {
  Reliability reliability;
  reliability.claims = 960;
  reliability.ece = 0.0314;
  reliability.brier = 0.1126;
  reliability.auc = 0.875;
  reliability.bins[9] = {400, 0.95, 0.96875};
  return reliability;
}

TEST(ReportTest, SaysBelowTheTableHowFarConfidenceIsToBeTrusted) {
  Report report = MakeReport();
  EXPECT_THAT(FormatReport(report), Not(HasSubstr("confidence")));
  report.reliability = MakeReliability();
  EXPECT_THAT(FormatReport(report), HasSubstr("\nconfidence: ECE 0.031, Brier 0.113, AUC 0.875 over 960 estimates\n"
                                              "skipped broken"));
  report.reliability->auc.reset();
  EXPECT_THAT(FormatReport(report), HasSubstr("\nconfidence: ECE 0.031, Brier 0.113 over 960 estimates\n"));
}

TEST(ReportTest, SaysHowManyIterationsWindowsTookWhereThereAreAny) {
  Report report = MakeReport();
  EXPECT_THAT(FormatReport(report), Not(HasSubstr("iterations")));
  report.sequences[0].iterations = 2.5;
  report.iterations = 2.456;
  EXPECT_THAT(FormatReport(report), HasSubstr("\niterations of a point's window, mean: 2.46\nskipped broken"));
  const auto written = nlohmann::json::parse(ReportsToJson({report}, {}))["reports"][0];
  EXPECT_EQ(written["iterations"], 2.456);
  EXPECT_EQ(written["sequences"][0]["iterations"], 2.5);
  EXPECT_TRUE(written["sequences"][1]["iterations"].is_null());
}

TEST(ReportTest, JsonHoldsTheReliabilityOfAMethodWithConfidence) {
  Report confident = MakeReport(), one_kind = MakeReport();
  confident.reliability = one_kind.reliability = MakeReliability();
  one_kind.reliability->auc.reset();
  const auto reports = nlohmann::json::parse(ReportsToJson({confident, one_kind, MakeReport()}, {}))["reports"];
  const auto& written = reports[0]["reliability"];
  EXPECT_EQ(written["claims"], 960);
  EXPECT_EQ(written["ece"], 0.0314);
  EXPECT_EQ(written["brier"], 0.1126);
  EXPECT_EQ(written["auc"], 0.875);
  ASSERT_EQ(written["bins"].size(), 10u);
  EXPECT_EQ(written["bins"][0]["claims"], 0);
  EXPECT_EQ(written["bins"][9]["claims"], 400);
  EXPECT_EQ(written["bins"][9]["confidence"], 0.95);
  EXPECT_EQ(written["bins"][9]["right"], 0.96875);
  EXPECT_TRUE(reports[1]["reliability"]["auc"].is_null());
  ASSERT_TRUE(reports[2].contains("reliability"));
  EXPECT_TRUE(reports[2]["reliability"].is_null());
}

TEST(ReportTest, SeveralProcessingSizesAreAllNamed) {
  Report report = MakeReport();
  report.sequences[0].processing_size = {640, 480};
  EXPECT_THAT(FormatReport(report), HasSubstr("processed at 512x384,640x480\n"));
}

TEST(ReportTest, JsonHoldsEveryFigureAndNullForWhatDoesNotExist) {
  Report report = MakeReport();
  report.mean.left_object = 2.5;
  report.mean.mte = std::numeric_limits<double>::infinity();
  const auto json = nlohmann::json::parse(ReportsToJson({report}, {{"iterations", "4"}}));
  EXPECT_EQ(json["settings"]["iterations"], "4");
  const auto& written = json["reports"][0];
  EXPECT_EQ(written["method"], "holdfast small");
  ASSERT_EQ(written["sequences"].size(), 2u);
  EXPECT_EQ(written["sequences"][0]["name"], "walk");
  EXPECT_EQ(written["sequences"][0]["processing_size"]["width"], 512);
  EXPECT_EQ(written["sequences"][0]["metrics"]["delta_avg"], 41.25);
  EXPECT_TRUE(written["sequences"][0]["metrics"]["aj"].is_null());
  EXPECT_EQ(written["skipped"][0]["reason"], "anno.npz is cut short");
  EXPECT_EQ(written["mean"]["delta_avg"], 45.625);
  EXPECT_TRUE(written["mean"]["mte"].is_null());
  EXPECT_EQ(written["mean"]["left_object"], 2.5);
  EXPECT_TRUE(written["sequences"][0]["metrics"]["left_object"].is_null());
}

TEST(ReportTest, JsonSurvivesNamesThatAreNotUtf8) {
  Report report = MakeReport();
  report.sequences[0].name = "\xff";
  EXPECT_TRUE(nlohmann::json::accept(ReportsToJson({report}, {})));
}

}  // namespace
}  // namespace holdfast
