// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace holdfast {
namespace {

using ::testing::DoubleNear;
using ::testing::Optional;

// Tolerance of numbers worked out by hand from float32 positions.
auto About(double value) { return Optional(DoubleNear(value, 1e-4)); }

// A video of 512x256 whose truth stands still at (100, 100): one pixel in x is half a scored pixel, one in y is one.
class Video {
 public:
  Video(int64_t frames, int64_t points) {
    video_.frame_size = {512, 256};
    video_.frames = frames;
    video_.points = points;
    video_.query_frames.assign(points, 0);
    video_.truth.assign(frames * points * 2, 100.0f);
    video_.estimate = video_.truth;
    video_.valid.assign(frames * points, 1);
    video_.true_visible.assign(frames * points, 1);
  }
  Video& QueryAt(int64_t point, int64_t frame) { return video_.query_frames[point] = frame, *this; }
  Video& OffX(int64_t frame, int64_t point, float pixels) {
    return video_.estimate[2 * video_.Index(frame, point)] += pixels, *this;
  }
  Video& OffY(int64_t frame, int64_t point, float pixels) {
    return video_.estimate[2 * video_.Index(frame, point) + 1] += pixels, *this;
  }
  Video& Hidden(int64_t frame, int64_t point) { return video_.true_visible[video_.Index(frame, point)] = 0, *this; }
  Video& Unknown(int64_t frame, int64_t point) { return video_.valid[video_.Index(frame, point)] = 0, *this; }
  Video& HiddenSomewhere(int64_t frame, int64_t point) {
    video_.hidden.resize(video_.valid.size(), 0);
    video_.hidden[video_.Index(frame, point)] = 1;
    return Hidden(frame, point).Unknown(frame, point);
  }
  Video& SaidVisible(std::vector<uint8_t> visible) { return video_.visible = std::move(visible), *this; }
  // The objects that the points lie on, and those that the estimates do, [S, N].
  Video& Objects(std::vector<int32_t> points, std::vector<int32_t> estimates) {
    video_.object_ids = std::move(points);
    video_.estimate_ids = std::move(estimates);
    return *this;
  }
  Metrics Score() const { return ComputeMetrics(video_); }

 private:
  ScoredVideo video_;
};

TEST(MetricsTest, PerfectTracksScoreFull) {
  const Metrics metrics = Video(4, 2).Score();
  EXPECT_THAT(metrics.delta_avg, About(100));
  EXPECT_THAT(metrics.delta_vis, About(100));
  EXPECT_THAT(metrics.survival_50, About(100));
  EXPECT_THAT(metrics.survival_16, About(100));
  EXPECT_THAT(metrics.mte, About(0));
  EXPECT_FALSE(metrics.delta_occ.has_value()) << "nothing is hidden";
  EXPECT_FALSE(metrics.oa.has_value()) << "the tracker says nothing about visibility";
  EXPECT_FALSE(metrics.aj.has_value());
}

TEST(MetricsTest, ErrorsAreMeasuredInA256x256Frame) {
  // 6 px in x are 3 scored pixels: within 4, 8 and 16 of the five thresholds.
  EXPECT_THAT(Video(2, 1).OffX(1, 0, 6).Score().delta_avg, About(60));
  EXPECT_THAT(Video(2, 1).OffX(1, 0, 6).Score().mte, About(3));
  // 6 px in x and 4 px in y are the hypotenuse of 3 and 4.
  EXPECT_THAT(Video(2, 1).OffX(1, 0, 6).OffY(1, 0, 4).Score().mte, About(5));
}

TEST(MetricsTest, AnErrorEqualToAThresholdIsNotWithinIt) {
  EXPECT_THAT(Video(2, 1).OffY(1, 0, 4).Score().delta_avg, About(40));
}

TEST(MetricsTest, DeltaPoolsThePairsOfAllTracks) {
  // Track 0 has three pairs, track 1 (queried at frame 2) one: 1 of 4 pairs is off by 3 px.
  EXPECT_THAT(Video(4, 2).QueryAt(1, 2).OffY(3, 1, 3).Score().delta_avg, About((3 * 100 + 60) / 4.0));
}

TEST(MetricsTest, VisibleAndHiddenPairsAreCountedApart) {
  // Frames 1..4: errors 0, 3 hidden, 0, 20 hidden.
  const Metrics metrics = Video(5, 1).Hidden(2, 0).OffY(2, 0, 3).Hidden(4, 0).OffY(4, 0, 20).Score();
  EXPECT_THAT(metrics.delta_vis, About(100));
  EXPECT_THAT(metrics.delta_occ, About(30));
  EXPECT_THAT(metrics.delta_avg, About(65));
}

TEST(MetricsTest, TheQueryFrameAndThoseBeforeDoNotCount) {
  const Metrics metrics = Video(4, 1).QueryAt(0, 2).OffY(0, 0, 90).OffY(1, 0, 90).OffY(2, 0, 90).Score();
  EXPECT_THAT(metrics.delta_avg, About(100));
  EXPECT_THAT(metrics.survival_16, About(100));
  EXPECT_THAT(metrics.mte, About(0));
}

TEST(MetricsTest, FramesWithoutTruthDoNotCount) {
  const Metrics metrics = Video(4, 1).OffY(2, 0, 90).Unknown(2, 0).Score();
  EXPECT_THAT(metrics.delta_avg, About(100));
  EXPECT_THAT(metrics.survival_50, About(100));
}

TEST(MetricsTest, SurvivalEndsAtTheFirstErrorBeyondTheLimit) {
  // Ten frames after the query; 20 px at the 4th of them, 60 px at the 9th, right again in between.
  const Metrics metrics = Video(11, 1).OffY(4, 0, 20).OffY(9, 0, 60).Score();
  EXPECT_THAT(metrics.survival_16, About(30));
  EXPECT_THAT(metrics.survival_50, About(80));
}

TEST(MetricsTest, AnErrorOfExactlyTheLimitSurvives) {
  EXPECT_THAT(Video(3, 1).OffY(1, 0, 16).Score().survival_16, About(100));
}

TEST(MetricsTest, SurvivalCountsFromEachTracksQuery) {
  // Track 0 fails at the first of 4 frames, track 1 (queried at frame 2) at the second of 2.
  EXPECT_THAT(Video(5, 2).OffY(1, 0, 99).QueryAt(1, 2).OffY(4, 1, 99).Score().survival_50, About((0 + 50) / 2.0));
}

TEST(MetricsTest, MedianErrorIsTakenPerTrack) {
  // Medians: of {1, 2, 9} 2; of {4, 4, 4} 4.
  Video video(4, 2);
  video.OffY(1, 0, 9).OffY(2, 0, 1).OffY(3, 0, 2).OffY(1, 1, 4).OffY(2, 1, 4).OffY(3, 1, 4);
  EXPECT_THAT(video.Score().mte, About(3));
}

TEST(MetricsTest, MedianOfAnEvenNumberOfErrorsIsTheMeanOfTheMiddleTwo) {
  EXPECT_THAT(Video(3, 1).OffY(1, 0, 2).OffY(2, 0, 5).Score().mte, About(3.5));
}

TEST(MetricsTest, ATrackWithoutTruthAfterItsQueryCountsNowhere) {
  const Metrics metrics = Video(3, 2).QueryAt(1, 2).OffY(2, 0, 90).Score();
  EXPECT_THAT(metrics.survival_50, About(50));
  EXPECT_FALSE(Video(3, 1).QueryAt(0, 2).Score().delta_avg.has_value());
}

TEST(MetricsTest, AnEstimateThatIsNotFiniteIsWrong) {
  const Metrics metrics = Video(4, 1).OffX(2, 0, std::numeric_limits<float>::quiet_NaN()).Score();
  EXPECT_THAT(metrics.delta_avg, About(200.0 / 3));
  EXPECT_THAT(metrics.survival_50, About(100.0 / 3));
}

TEST(MetricsTest, OcclusionAccuracyIsTheShareOfRightVisibility) {
  // Truth after the query: 1 0 1 1; said: 1 1 0 1.
  EXPECT_THAT(Video(5, 1).Hidden(2, 0).SaidVisible({1, 1, 1, 0, 1}).Score().oa, About(50));
}

TEST(MetricsTest, AverageJaccardFollowsTapVid) {
  // Truth after the query 1 0 1 1, said 1 1 0 1, errors 0 0 0 3: three truths; the second is a false alarm at every
  // threshold, the last one a hit from 4 px on and a false alarm below. 1/5 at 1 and 2 px, 2/4 at 4, 8 and 16 px.
  const Metrics metrics = Video(5, 1).Hidden(2, 0).OffY(4, 0, 3).SaidVisible({1, 1, 1, 0, 1}).Score();
  EXPECT_THAT(metrics.aj, About(100 * (2 * 0.2 + 3 * 0.5) / 5));
}

// Of three frames after the query the second is hidden, nobody knows where: no position counts there, whether it is
// said to be visible does.
TEST(MetricsTest, WhereNobodyKnowsThePlaceOnlyVisibilityCounts) {
  const Metrics metrics = Video(4, 1).HiddenSomewhere(2, 0).OffY(2, 0, 90).SaidVisible({1, 1, 1, 1}).Score();
  EXPECT_THAT(metrics.delta_avg, About(100));
  EXPECT_THAT(metrics.survival_16, About(100));
  EXPECT_THAT(metrics.mte, About(0));
  EXPECT_FALSE(metrics.delta_occ.has_value());
  EXPECT_THAT(metrics.oa, About(100.0 * 2 / 3));
  EXPECT_THAT(metrics.aj, About(100.0 * 2 / 3));
}

// Two frames after the query, both hidden: nothing is said of positions. One of two is said to be visible, which is a
// false alarm at every threshold.
TEST(MetricsTest, VisibilityCountsWhereEveryPointIsHiddenAfterItsQuery) {
  const Metrics metrics = Video(3, 1).HiddenSomewhere(1, 0).HiddenSomewhere(2, 0).SaidVisible({1, 0, 1}).Score();
  EXPECT_FALSE(metrics.delta_avg.has_value());
  EXPECT_FALSE(metrics.survival_16.has_value());
  EXPECT_FALSE(metrics.mte.has_value());
  EXPECT_THAT(metrics.oa, About(50));
  EXPECT_THAT(metrics.aj, About(0));
}

// TAP-Vid divides the hits by the true "visible" and the false alarms: nothing by nothing here.
TEST(MetricsTest, WithoutVisiblePointsAndFalseAlarmsThereIsNoJaccard) {
  const Metrics nowhere = Video(3, 1).HiddenSomewhere(1, 0).HiddenSomewhere(2, 0).SaidVisible({1, 0, 0}).Score();
  EXPECT_THAT(nowhere.oa, About(100));
  EXPECT_FALSE(nowhere.aj.has_value());
  const Metrics placed = Video(3, 1).Hidden(1, 0).Hidden(2, 0).SaidVisible({1, 0, 0}).Score();
  EXPECT_THAT(placed.delta_occ, About(100));
  EXPECT_FALSE(placed.aj.has_value());
}

TEST(MetricsTest, WithoutFramesAfterTheQueryThereIsNothingToMeasure) {
  const Metrics metrics = Video(3, 1).QueryAt(0, 2).SaidVisible({1, 1, 1}).Score();
  for (const MetricColumn& column : MetricColumns()) EXPECT_FALSE((metrics.*column.value).has_value()) << column.key;
}

TEST(MetricsTest, AnEstimateHasLeftItsObjectWhereAnotherOneIsUnderIt) {
  // Point 0 lies on object 3 and has left it in one of three frames, point 1 on object 5 in two, once for nothing at
  // all.
  EXPECT_THAT(Video(4, 2).Objects({3, 5}, {3, 5, 3, 3, 5, 5, 3, 0}).Score().left_object, About(50));
  EXPECT_THAT(Video(2, 1).Objects({3}, {3, 3}).Score().left_object, About(0));
}

TEST(MetricsTest, OnlyVisiblePointsCanHaveLeftTheirObject) {
  EXPECT_THAT(Video(4, 1).Hidden(2, 0).Objects({3}, {3, 3, 5, 5}).Score().left_object, About(50));
  EXPECT_FALSE(Video(3, 1).Hidden(1, 0).Hidden(2, 0).Objects({3}, {3, 5, 5}).Score().left_object.has_value());
}

TEST(MetricsTest, NeitherTheQueryNorFramesWithoutTruthCountForLeftObjects) {
  const Video video = Video(5, 1).QueryAt(0, 1).Unknown(2, 0).Objects({3}, {5, 5, 5, 3, 5});
  EXPECT_THAT(video.Score().left_object, About(50));
}

TEST(MetricsTest, PointsOfUnknownObjectsHaveLeftNone) {
  EXPECT_THAT(Video(3, 2).Objects({0, 4}, {7, 4, 7, 4, 7, 9}).Score().left_object, About(50));
  EXPECT_FALSE(Video(3, 1).Objects({0}, {0, 7, 7}).Score().left_object.has_value());
}

TEST(MetricsTest, WithoutMasksNobodyKnowsWhatHasLeftItsObject) {
  EXPECT_FALSE(Video(3, 1).Score().left_object.has_value());
  EXPECT_FALSE(Video(3, 1).Objects({3}, {}).Score().left_object.has_value());
}

TEST(MetricsTest, EveryMetricIsAColumnOfItsOwn) {
  std::set<std::string> names, headers;
  for (const MetricColumn& column : MetricColumns()) {
    EXPECT_TRUE(names.insert(column.key).second) << column.key;
    EXPECT_TRUE(headers.insert(column.header).second) << column.header;
  }
  EXPECT_EQ(sizeof(Metrics), MetricColumns().size() * sizeof(std::optional<double>));
  EXPECT_EQ(MetricColumns().back().value, &Metrics::left_object);
}

TEST(MetricsTest, MeansSkipVideosThatLackTheMetric) {
  Metrics first;
  first.delta_avg = 40;
  first.delta_occ = 10;
  Metrics second;
  second.delta_avg = 60;
  second.left_object = 4;
  const Metrics mean = MeanMetrics({first, second});
  EXPECT_THAT(mean.delta_avg, About(50));
  EXPECT_THAT(mean.delta_occ, About(10));
  EXPECT_THAT(mean.left_object, About(4));
  EXPECT_FALSE(mean.mte.has_value());
  EXPECT_FALSE(MeanMetrics({}).delta_avg.has_value());
}

}  // namespace
}  // namespace holdfast
