// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

TEST(GridPointsTest, CellsAreNearlySquareAndTheirCentresTileTheFrame) {
  const auto points = GridPoints(12, {40, 30});
  ASSERT_EQ(points.size(), 12u);  // 4 x 3 cells of 10 x 10
  EXPECT_EQ(points[0], cv::Point2f(4.5f, 4.5f));
  EXPECT_EQ(points[1], cv::Point2f(14.5f, 4.5f));
  EXPECT_EQ(points[11], cv::Point2f(34.5f, 24.5f));
}

TEST(GridPointsTest, AnyCountOnAnyShapeIsNearlyMetAndStaysInside) {
  for (const ImageSize size : {ImageSize{768, 576}, ImageSize{2000, 20}, ImageSize{3, 900}, ImageSize{1, 1}}) {
    for (int count : {1, 2, 7, 100, 1000}) {
      const auto points = GridPoints(count, size);
      ASSERT_FALSE(points.empty());
      EXPECT_LE(points.size(), static_cast<size_t>(count) * 3 / 2 + 1);
      for (const auto& p : points) {
        EXPECT_TRUE(p.x >= 0 && p.y >= 0 && p.x <= size.width - 1 && p.y <= size.height - 1) << p;
      }
    }
  }
  EXPECT_NEAR(static_cast<double>(GridPoints(100, {768, 576}).size()), 100, 10);
}

class CollectPointsTest : public ::testing::Test {
 protected:
  std::string Mask(int width, int height, int value) {
    cv::imwrite(dir_.File("mask.png"), cv::Mat(height, width, CV_8U, cv::Scalar(value)));
    return dir_.File("mask.png");
  }
  TempDir dir_;
};

TEST_F(CollectPointsTest, NoSourceAtAllIsAnErrorThatNamesTheFlags) {
  EXPECT_THAT(PointOptions{}.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--grid")));
  PointOptions options;
  options.grid = -4;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--grid")));
  options.grid = 4;
  EXPECT_THAT(options.Validate(), IsOk());
}

TEST_F(CollectPointsTest, GridPointsGetTheIdsAfterThoseOfTheFile) {
  std::ofstream(dir_.File("p.csv")) << "41,1,2,5\n7,3,4\n";
  PointOptions options;
  options.file = dir_.File("p.csv");
  options.grid = 4;
  options.query_frame = 2;
  const auto points = CollectPoints(options, {20, 20});
  ASSERT_THAT(points, IsOk());
  ASSERT_EQ(points->size(), 6u);
  EXPECT_EQ((*points)[0].query.id, 41u);
  EXPECT_EQ((*points)[0].frame, 5);
  EXPECT_EQ((*points)[2].query.id, 42u);
  EXPECT_EQ((*points)[5].query.id, 45u);
  EXPECT_EQ((*points)[5].frame, 2);
}

TEST_F(CollectPointsTest, AMaskIsAnObjectAndItsPointsGetTheIdsAfterTheOthers) {
  PointOptions options;
  options.mask = Mask(40, 30, 1);
  options.grid = 5;
  options.query_frame = 3;
  EXPECT_THAT(CollectPoints(options, {40, 30}), IsOkAndHolds(::testing::IsEmpty()));
  const auto object = CollectObject(options, {40, 30}, {{{7, 1, 2}, 0, "7"}});
  ASSERT_THAT(object, IsOk());
  ASSERT_TRUE(object->has_value());
  EXPECT_EQ((*object)->first_point, 8u);
  EXPECT_EQ((*object)->frame, 3);
  EXPECT_EQ((*object)->query.points, 5);
  const std::string& png = (*object)->query.mask_png;
  const cv::Mat mask = cv::imdecode(std::vector<char>(png.begin(), png.end()), cv::IMREAD_GRAYSCALE);
  EXPECT_EQ(cv::countNonZero(mask), 40 * 30);
  options.query_frame = -1;
  EXPECT_EQ((*CollectObject(options, {40, 30}, {}, 9))->frame, 9) << "the first one that is tracked";
  options.mask.clear();
  const auto none = CollectObject(options, {40, 30}, {});
  ASSERT_THAT(none, IsOk());
  EXPECT_FALSE(none->has_value());
  options.mask = "m.png";
  options.grid = 257;
  EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at most 256")));
}

TEST_F(CollectPointsTest, WrongMasksAreErrors) {
  PointOptions options;
  const auto says = [&options](const char* text) {
    EXPECT_THAT(CollectObject(options, {40, 30}, {}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(text)));
  };
  options.mask = Mask(40, 30, 0);
  says("all zero");
  options.mask = Mask(40, 31, 1);
  says("40x31");
  std::ofstream(dir_.File("mask.png")) << "no picture";
  says("mask.png");
}

}  // namespace
}  // namespace holdfast
