// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr ImageSize kSize{100, 50};

TEST(PointFileTest, CsvLinesGiveIdPositionAndFrame) {
  const auto points = ParsePointsCsv("id,x,y,frame\r\n# people\n7,1.5,2,3\r\n\n 8 , 99 , 49 ,0\n9,0,0", kSize);
  ASSERT_THAT(points, IsOk());
  ASSERT_EQ(points->size(), 3u);
  EXPECT_EQ((*points)[0].query.id, 7u);
  EXPECT_EQ((*points)[0].query.x, 1.5f);
  EXPECT_EQ((*points)[0].query.y, 2.0f);
  EXPECT_EQ((*points)[0].frame, 3);
  EXPECT_EQ((*points)[0].name, "7");
  EXPECT_EQ((*points)[1].query.x, 99.0f);
  EXPECT_EQ((*points)[2].frame, 0);
}

TEST(PointFileTest, ASpreadsheetsByteOrderMarkIsPassedOver) {
  const auto points = ParsePointsCsv("\xEF\xBB\xBFid,x,y\r\n7,1,2\r\n", kSize);
  ASSERT_THAT(points, IsOk());
  EXPECT_EQ((*points)[0].query.id, 7u);
}

TEST(PointFileTest, CsvErrorsNameTheLineAndTheField) {
  EXPECT_THAT(ParsePointsCsv("1,2,3\n1.5,2,3", kSize), StatusIs(kInvalid, AllOf(HasSubstr("line 2"), HasSubstr("id"))));
  EXPECT_THAT(ParsePointsCsv("1,left,3", kSize), StatusIs(kInvalid, HasSubstr("line 1: x is left")));
  EXPECT_THAT(ParsePointsCsv("1,2,", kSize), StatusIs(kInvalid, HasSubstr("line 1: y")));
  EXPECT_THAT(ParsePointsCsv("1,2,3,soon", kSize), StatusIs(kInvalid, HasSubstr("frame is soon")));
  EXPECT_THAT(ParsePointsCsv("1,2,3,-1", kSize), StatusIs(kInvalid, HasSubstr("frame is -1")));
  EXPECT_THAT(ParsePointsCsv("1;2;3", kSize), StatusIs(kInvalid, HasSubstr("of 1 fields")));
  EXPECT_THAT(ParsePointsCsv("1,2,3,4,5", kSize), StatusIs(kInvalid, HasSubstr("of 5 fields")));
}

TEST(PointFileTest, PointsOutsideTheFrameAreRefused) {
  EXPECT_THAT(ParsePointsCsv("1,99.5,3", kSize), StatusIs(kInvalid, HasSubstr("x is 99.5, expected 0..99")));
  EXPECT_THAT(ParsePointsCsv("1,3,-0.5", kSize), StatusIs(kInvalid, HasSubstr("y is -0.5, expected 0..49")));
  EXPECT_THAT(ParsePointsCsv("1,nan,3", kSize), StatusIs(kInvalid, HasSubstr("x is nan")));
  EXPECT_THAT(ParsePointsCsv("1,2,inf", kSize), StatusIs(kInvalid, HasSubstr("y is inf")));
}

TEST(PointFileTest, AnIdMayBeUsedOnceOnly) {
  EXPECT_THAT(ParsePointsCsv("5,1,1\n6,1,1\n5,2,2", kSize),
              StatusIs(kInvalid, AllOf(HasSubstr("line 3"), HasSubstr("5 again"), HasSubstr("line 1"))));
  EXPECT_THAT(ParsePointsCsv("18446744073709551615,1,1", kSize), StatusIs(kInvalid, HasSubstr("less than 2^53")));
}

TEST(PointFileTest, AFileWithoutPointsIsAnError) {
  EXPECT_THAT(ParsePointsCsv("id,x,y\n", kSize), StatusIs(kInvalid, HasSubstr("no points")));
  EXPECT_THAT(ParsePointsJson("[]", kSize), StatusIs(kInvalid, HasSubstr("no points")));
}

TEST(PointFileTest, JsonListsMayBeBareOrUnderPoints) {
  for (const char* text : {R"([{"id": 7, "x": 1.5, "y": 2, "frame": 3, "name": "nose"}, {"id": 8, "x": 0, "y": 0}])",
                           R"({"points": [{"id": 7, "x": 1.5, "y": 2, "frame": 3, "name": "nose"},
                                          {"id": 8, "x": 0, "y": 0}]})"}) {
    const auto points = ParsePointsJson(text, kSize);
    ASSERT_THAT(points, IsOk());
    ASSERT_EQ(points->size(), 2u);
    EXPECT_EQ((*points)[0].query.x, 1.5f);
    EXPECT_EQ((*points)[0].frame, 3);
    EXPECT_EQ((*points)[0].name, "nose");
    EXPECT_EQ((*points)[1].name, "8");
  }
}

TEST(PointFileTest, JsonErrorsNameTheElementAndTheField) {
  EXPECT_THAT(ParsePointsJson(R"([{"id": 1, "x": 1, "y": 1}, {"id": 2, "x": "1", "y": 1}])", kSize),
              StatusIs(kInvalid, HasSubstr("points[1]: x is \"1\", expected a number")));
  EXPECT_THAT(ParsePointsJson(R"([{"x": 1, "y": 1}])", kSize), StatusIs(kInvalid, HasSubstr("points[0]: id is null")));
  EXPECT_THAT(ParsePointsJson(R"([{"id": -1, "x": 1, "y": 1}])", kSize), StatusIs(kInvalid, HasSubstr("id is -1")));
  EXPECT_THAT(ParsePointsJson(R"([{"id": 1, "x": 1e300, "y": 1}])", kSize), StatusIs(kInvalid, HasSubstr("x is inf")));
  EXPECT_THAT(ParsePointsJson(R"([{"id": 1, "x": 1, "y": 1, "frame": 0.5}])", kSize),
              StatusIs(kInvalid, HasSubstr("frame is 0.5")));
  EXPECT_THAT(ParsePointsJson(R"([{"id": 1, "x": 1, "y": 1, "name": 3}])", kSize),
              StatusIs(kInvalid, HasSubstr("name is 3")));
  EXPECT_THAT(ParsePointsJson("[3]", kSize), StatusIs(kInvalid, HasSubstr("points[0]: the point is 3")));
}

TEST(PointFileTest, WhatIsNoListOfPointsIsAnErrorAndNoCrash) {
  EXPECT_THAT(ParsePointsJson("{\"points\": 3}", kSize), StatusIs(kInvalid, HasSubstr("expected a list")));
  EXPECT_THAT(ParsePointsJson("null", kSize), StatusIs(kInvalid));
  EXPECT_THAT(ParsePointsJson("[{\"id\": 1", kSize), StatusIs(kInvalid, HasSubstr("line 1")));
  EXPECT_THAT(ParsePointsJson("\xff\xfe", kSize), StatusIs(kInvalid, HasSubstr("is not JSON")));
  EXPECT_THAT(ParsePointsJson(std::string(200000, '['), kSize), StatusIs(kInvalid, HasSubstr("is not JSON")));
}

TEST(PointFileTest, FilesAreReadByTheirSuffixAndNamedInErrors) {
  const TempDir dir;
  const std::string csv = dir.File("p.CSV");
  std::ofstream(csv) << "1,2,3\n";
  ASSERT_THAT(ReadPointFile(csv, kSize), IsOk());
  std::ofstream(dir.File("bad.json")) << "1,2,3\n";
  EXPECT_THAT(ReadPointFile(dir.File("bad.json"), kSize), StatusIs(kInvalid, HasSubstr("bad.json: is not JSON")));
  EXPECT_THAT(ReadPointFile(dir.File("p.txt"), kSize), StatusIs(kInvalid, HasSubstr(".csv or .json")));
  EXPECT_THAT(ReadPointFile(dir.File("none.csv"), kSize),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.csv: cannot be read")));
  EXPECT_FALSE(ReadPointFile(dir.path().string() + "/.csv", kSize).ok());
  std::filesystem::create_directory(dir.File("d.csv"));
  EXPECT_THAT(ReadPointFile(dir.File("d.csv"), kSize), StatusIs(kInvalid, HasSubstr("d.csv: is a directory")));
}

}  // namespace
}  // namespace holdfast
