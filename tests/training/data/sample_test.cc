// SPDX-License-Identifier: Apache-2.0
#include "training/data/sample.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// 2 frames of 8 x 6 with 3 points; all numbers tell frame and point apart.
Sample Example() {
  Sample sample;
  sample.source = "example";
  sample.frames = {cv::Mat(6, 8, CV_8UC3, cv::Scalar()), cv::Mat(6, 8, CV_8UC3, cv::Scalar())};
  sample.tracks = {0, 1, 2, 3, 4, 5, 1, 1, 3, 3, 5, 5};
  sample.visible = {1, 0, 0, 0, 1, 0};
  sample.valid = {1, 1, 0, 1, 1, 1};
  sample.object_ids = {7, 8, 9};
  sample.masks = {cv::Mat(6, 8, CV_32SC1, cv::Scalar(3)), cv::Mat(6, 8, CV_32SC1, cv::Scalar(4))};
  return sample;
}

TEST(SampleTest, ArraysAreFrameByFrame) {
  Sample sample = Example();
  EXPECT_EQ(sample.size(), (ImageSize{8, 6}));
  EXPECT_EQ(sample.Position(0, 2), cv::Point2f(4, 5));
  EXPECT_EQ(sample.Position(1, 0), cv::Point2f(1, 1));
  EXPECT_TRUE(sample.Visible(1, 1));
  EXPECT_FALSE(sample.Valid(0, 2));
  sample.SetPosition(1, 0, {0.5f, 2.5f});
  EXPECT_THAT(sample.tracks, ElementsAre(0, 1, 2, 3, 4, 5, 0.5f, 2.5f, 3, 3, 5, 5));
}

TEST(SampleTest, TheFrameEndsAtTheCentresOfItsBorderPixels) {
  const Sample sample = Example();
  EXPECT_TRUE(sample.Inside({0, 0}));
  EXPECT_TRUE(sample.Inside({7, 5}));
  EXPECT_FALSE(sample.Inside({7.01f, 5}));
  EXPECT_FALSE(sample.Inside({7, 5.01f}));
  EXPECT_FALSE(sample.Inside({-0.01f, 0}));
  EXPECT_FALSE(sample.Inside({0, -0.01f}));
  EXPECT_FALSE(sample.Inside({std::nanf(""), 0}));
}

TEST(SampleTest, APointIsQueriedWhereItIsFirstBothValidAndVisible) {
  Sample sample = Example();
  EXPECT_EQ(sample.QueryFrame(0), 0);
  EXPECT_EQ(sample.QueryFrame(1), 1) << "hidden at first";
  EXPECT_EQ(sample.QueryFrame(2), -1) << "never visible";
  sample.valid[sample.At(0, 0)] = 0;
  EXPECT_EQ(sample.QueryFrame(0), -1) << "visible only where it is not valid";
}

TEST(SampleTest, SelectedPointsComeInTheOrderGivenWithAllThatIsTheirs) {
  Sample sample = Example();
  sample.SelectPoints({2, 0});
  EXPECT_THAT(sample.tracks, ElementsAre(4, 5, 0, 1, 5, 5, 1, 1));
  EXPECT_THAT(sample.visible, ElementsAre(0, 1, 0, 0));
  EXPECT_THAT(sample.valid, ElementsAre(0, 1, 1, 1));
  EXPECT_THAT(sample.object_ids, ElementsAre(9, 7));
  EXPECT_THAT(sample.Validate(), IsOk());
  sample.SelectPoints({});
  EXPECT_THAT(sample.tracks, IsEmpty());
  EXPECT_THAT(sample.Validate(), IsOk()) << "a clip without points";
}

TEST(SampleTest, NewPointsAreNowhereAndReplaceTheOldOnes) {
  Sample sample = Example();
  sample.AllocatePoints(5);
  EXPECT_THAT(sample.tracks, AllOf(SizeIs(20), Each(0.0f)));
  EXPECT_THAT(sample.visible, AllOf(SizeIs(10), Each(0)));
  EXPECT_THAT(sample.valid, AllOf(SizeIs(10), Each(0)));
  EXPECT_THAT(sample.object_ids, AllOf(SizeIs(5), Each(0)));
}

TEST(SampleTest, IdsAreThoseUnderTheNearestPixelOfTheirFrameAndZeroOutside) {
  Sample sample = Example();
  sample.masks[0].at<int32_t>(4, 5) = 8;
  EXPECT_EQ(sample.IdAt(0, {5.4f, 3.6f}), 8);
  EXPECT_EQ(sample.IdAt(0, {5.6f, 3.6f}), 3);
  EXPECT_EQ(sample.IdAt(1, {5.4f, 3.6f}), 4);
  EXPECT_EQ(sample.IdAt(0, {7.4f, 5.4f}), 3) << "still on the last pixel";
  for (const cv::Point2f outside : {cv::Point2f(-0.6f, 3), cv::Point2f(7.6f, 3), cv::Point2f(3, -0.6f),
                                    cv::Point2f(3, 5.6f), cv::Point2f(1e30f, 3), cv::Point2f(std::nanf(""), 3)}) {
    EXPECT_EQ(sample.IdAt(0, outside), 0) << outside;
  }
  sample.masks.clear();
  EXPECT_EQ(sample.IdAt(0, {3, 3}), 0);
}

TEST(SampleTest, EveryBrokenPromiseIsNamedWithTheSource) {
  ASSERT_THAT(Example().Validate(), IsOk());
  const float infinity = std::numeric_limits<float>::infinity();
  const std::vector<std::pair<std::string, std::function<void(Sample&)>>> faults = {
      {"no frames", [](Sample& s) { s.frames.clear(); }},
      {"not 8-bit RGB", [](Sample& s) { s.frames[1] = cv::Mat(6, 8, CV_8UC1); }},
      {"not 8-bit RGB", [](Sample& s) { s.frames[1] = cv::Mat(); }},
      {"frames differ in size", [](Sample& s) { s.frames[1] = cv::Mat(6, 7, CV_8UC3); }},
      {"a mask is missing", [](Sample& s) { s.masks.pop_back(); }},
      {"not 32-bit ids", [](Sample& s) { s.masks[1] = cv::Mat(6, 8, CV_8UC1); }},
      {"a mask differs in size", [](Sample& s) { s.masks[1] = cv::Mat(5, 8, CV_32SC1); }},
      {"do not have 2 x 3", [](Sample& s) { s.tracks.pop_back(); }},
      {"do not have 2 x 3", [](Sample& s) { s.visible.push_back(0); }},
      {"do not have 2 x 3", [](Sample& s) { s.valid.clear(); }},
      {"do not have 2 x 2", [](Sample& s) { s.object_ids.pop_back(); }},
      {"not finite", [](Sample& s) { s.tracks[5] = std::nanf(""); }},
      {"not finite", [=](Sample& s) { s.tracks[11] = -infinity; }},
      {"point 1 is visible in frame 1", [](Sample& s) { s.valid[s.At(1, 1)] = 0; }},
      {"point 0 is visible in frame 0",
       [](Sample& s) {
         s.SetPosition(0, 0, {0, 5.5f});
       }},
  };
  for (const auto& [what, damage] : faults) {
    Sample sample = Example();
    damage(sample);
    EXPECT_THAT(sample.Validate(),
                StatusIs(absl::StatusCode::kInternal, AllOf(HasSubstr("'example'"), HasSubstr(what))));
  }
}

}  // namespace
}  // namespace holdfast
