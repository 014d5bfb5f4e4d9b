// SPDX-License-Identifier: Apache-2.0
#include "training/data/track_selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Four frames of 100 x 50 with one track each, all visible and valid.
Sample Tracks(const std::vector<std::vector<cv::Point2f>>& tracks) {
  Sample sample;
  sample.frames.assign(tracks[0].size(), cv::Mat(50, 100, CV_8UC3, cv::Scalar()));
  sample.AllocatePoints(static_cast<int64_t>(tracks.size()));
  std::fill(sample.visible.begin(), sample.visible.end(), 1);
  std::fill(sample.valid.begin(), sample.valid.end(), 1);
  for (size_t n = 0; n < tracks.size(); ++n) {
    for (size_t s = 0; s < tracks[n].size(); ++s)
      sample.SetPosition(static_cast<int64_t>(s), static_cast<int64_t>(n), tracks[n][s]);
  }
  return sample;
}

std::vector<int64_t> Good(Sample sample, const TrackRules& rules = TrackRules::Training()) {
  MarkOutside(rules, sample);
  return GoodTracks(rules, sample);
}

TEST(TrackSelectionTest, TheBordersDecideWhatIsVisibleAndValid) {
  Sample sample =
      Tracks({{{1, 1}, {0.9f, 20}, {-64, 20}, {-64.1f, 20}}, {{98, 48}, {98.1f, 48}, {50, 113}, {50, 113.1f}}});
  MarkOutside(TrackRules::Training(), sample);
  EXPECT_THAT(sample.visible, ElementsAre(1, 1, 0, 0, 0, 0, 0, 0));
  EXPECT_THAT(sample.valid, ElementsAre(1, 1, 1, 1, 1, 1, 0, 0));
}

TEST(TrackSelectionTest, TheEvaluationScoresNothingWithinAPixelOfTheBorder) {
  Sample sample = Tracks({{{1, 1}, {0.9f, 20}, {50, 0.9f}, {98, 20}}, {{98, 48}, {98.1f, 48}, {50, 48.1f}, {-9, 20}}});
  MarkOutside(TrackRules::Evaluation(), sample);
  EXPECT_THAT(sample.visible, ElementsAre(1, 1, 0, 0, 0, 0, 1, 0));
  EXPECT_EQ(sample.valid, sample.visible);
}

TEST(TrackSelectionTest, TracksMustBeSeenAtTheStartAndOftenEnough) {
  const std::vector<cv::Point2f> still(9, {30, 20});
  Sample sample = Tracks({still, still, still, still});
  sample.visible[sample.At(1, 1)] = 0;
  for (int64_t s = 2; s < 9; ++s) sample.visible[sample.At(s, 2)] = 0;  // 2 of 9, three are wanted
  for (int64_t s = 3; s < 9; ++s) sample.visible[sample.At(s, 3)] = 0;
  EXPECT_THAT(Good(sample), ElementsAre(0, 3));
}

TEST(TrackSelectionTest, WildTracksAreDroppedByEachOfTheThreeBounds) {
  // Larger side 100: velocity below 40, acceleration below 30, jerk below 10 pixels a frame.
  EXPECT_THAT(Good(Tracks({{{5, 20}, {44, 20}, {83, 20}, {90, 20}}})), IsEmpty()) << "it stops at once";
  EXPECT_THAT(Good(Tracks({{{5, 20}, {34, 20}, {63, 20}, {92, 20}}})), ElementsAre(0));
  EXPECT_THAT(Good(Tracks({{{5, 20}, {46, 20}, {87, 20}, {128, 20}}})), IsEmpty()) << "41 a frame";
  EXPECT_THAT(Good(Tracks({{{40, 20}, {40, 20}, {49, 20}, {67, 20}}})), ElementsAre(0)) << "jerk 0";
  EXPECT_THAT(Good(Tracks({{{40, 20}, {40, 20}, {40, 20}, {51, 20}}})), IsEmpty()) << "jerk 11";
  TrackRules only_acceleration = TrackRules::Training();
  only_acceleration.max_jerk = 0;
  EXPECT_THAT(Good(Tracks({{{40, 20}, {40, 20}, {40, 20}, {71, 20}}}), only_acceleration), IsEmpty());
  EXPECT_THAT(Good(Tracks({{{40, 20}, {40, 20}, {40, 20}, {69, 20}}}), only_acceleration), ElementsAre(0));
}

TEST(TrackSelectionTest, AGapInTheLabelsIsNoMotion) {
  Sample sample = Tracks({{{5, 20}, {6, 20}, {0, 0}, {80, 20}}});
  sample.valid[2] = 0;
  EXPECT_THAT(Good(sample), ElementsAre(0));
}

TEST(TrackSelectionTest, TheEvaluationKeepsWhatIsSeenEightTimes) {
  const std::vector<cv::Point2f> still(10, {30, 20});
  std::vector<cv::Point2f> jumps = still;
  jumps[5] = {90, 40};
  Sample sample = Tracks({still, jumps, still});
  for (int64_t s = 1; s < 4; ++s) sample.visible[sample.At(s, 2)] = 0;
  EXPECT_THAT(Good(sample, TrackRules::Evaluation()), ElementsAre(0, 1));
}

TEST(TrackSelectionTest, SpreadOutTakesTheFarthestFirst) {
  const auto at = [](float x) { return std::vector<cv::Point2f>(4, {x, 20}); };
  const Sample sample = Tracks({at(10), at(12), at(90), at(50), at(11)});
  EXPECT_THAT(SpreadOut(sample, {0, 1, 2, 3, 4}, 3), ElementsAre(0, 2, 3));
  EXPECT_THAT(SpreadOut(sample, {1, 4}, 3), ElementsAre(1, 4));
}

TEST(TrackSelectionTest, SpreadOutLooksAtMotionToo) {
  Sample sample = Tracks({std::vector<cv::Point2f>(4, {10, 20}),
                          std::vector<cv::Point2f>(4, {11, 20}),
                          {{10, 20}, {15, 20}, {20, 20}, {25, 20}}});
  EXPECT_THAT(SpreadOut(sample, {0, 1, 2}, 2), ElementsAre(0, 2));
}

TEST(TrackSelectionTest, PointsThatCoincideAreTakenOnceEach) {
  const Sample sample = Tracks(std::vector<std::vector<cv::Point2f>>(5, std::vector<cv::Point2f>(4, {10, 20})));
  EXPECT_THAT(SpreadOut(sample, {0, 1, 2, 3, 4}, 4), ::testing::UnorderedElementsAre(0, 1, 2, 3));
}

TEST(TrackSelectionTest, EvenlyPickedKeepsTheOrder) {
  EXPECT_THAT(EvenlyPicked({2, 4, 6, 8, 10, 12}, 3), ElementsAre(2, 6, 10));
  EXPECT_THAT(EvenlyPicked({2, 4}, 3), ElementsAre(2, 4));
  EXPECT_THAT(EvenlyPicked({2, 4}, 0), ElementsAre(2, 4));
}

TEST(TrackSelectionTest, PaddingIsNowhereValidAndLeavesTheRestAlone) {
  Sample sample = Tracks({{{1, 2}, {3, 4}}, {{5, 6}, {7, 8}}});
  PadPoints(4, sample);
  EXPECT_THAT(sample.Validate(), IsOk());
  EXPECT_EQ(sample.num_points(), 4);
  EXPECT_EQ(sample.Position(1, 1), cv::Point2f(7, 8));
  EXPECT_THAT(sample.valid, ElementsAre(1, 1, 0, 0, 1, 1, 0, 0));
}

}  // namespace
}  // namespace holdfast
