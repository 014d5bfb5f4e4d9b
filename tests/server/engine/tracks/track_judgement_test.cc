// SPDX-License-Identifier: Apache-2.0
// How estimates are judged as they become final, and what a sink hears of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "tests/server/engine/tracks/track_set_harness.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::FloatEq;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// How the final estimates of a point were judged.
struct Verdict {
  float confidence = 0;
  bool visible = false;
};
std::map<int64_t, Verdict> FinalVerdicts(const std::vector<PointRun>& runs, PointId id) {
  std::map<int64_t, Verdict> finals;
  for (const PointRun& run : runs) {
    for (int64_t i = 0; run.id == id && i < run.final_count; ++i) {
      finals[run.first_frame + i] = {run.confidence[i], run.visible[i] != 0};
    }
  }
  return finals;
}

// Of confidence 3/4 where the feature is 1 and nothing else counts.
Calibration ThreeQuartersBy(size_t feature) {
  Calibration::Features weights{};
  weights[feature] = std::log(3.0);
  return Calibration(weights);
}
constexpr size_t kConstant = 0, kFoundFromQuery = 6;

const auto kAllFromQuery = [](int64_t) { return Evidence::Polish::kFromQuery; };

TEST(TrackSetTest, TheSinkHearsOfEachFrameOnceWhenItBecomesFinalButNotOfTheQuery) {
  TrackSetHarness harness({24, 8});
  harness.model().similarity = 0.5f;
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(22);
  EXPECT_THAT(harness.heard(), IsEmpty()) << "early windows make nothing final";
  harness.FramesAndRun(1);
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 8));
  harness.FramesAndRun(16);
  harness.Finish();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 39));
  for (const Heard& heard : harness.heard()) {
    EXPECT_TRUE(std::isnan(heard.evidence.visibility_logit)) << "the network has no such head";
    EXPECT_EQ(heard.evidence.similarity, 0.5f);
    EXPECT_EQ(heard.evidence.last_step, 0);
    EXPECT_EQ(heard.evidence.age, heard.frame);
    EXPECT_EQ(heard.evidence.polish, Evidence::Polish::kNotTried);
  }
}

TEST(TrackSetTest, TheSinkHearsTheAgeFromTheQueryOn) {
  TrackSetHarness harness({24, 8});
  for (int i = 0; i < 6; ++i) harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(6, 35));
  for (const Heard& heard : harness.heard()) EXPECT_EQ(heard.evidence.age, heard.frame - 5);
}

TEST(TrackSetTest, TheSinkHearsTheLogitOfTheEstimateThatBecomesFinal) {
  TrackSetHarness harness({6, 3, /*early=*/false});
  harness.Frame();
  harness.Seed(1);
  for (int i = 0; i < 5; ++i) harness.Frame();
  const std::vector<DueRow> rows = harness.tracks().Due(false);
  ASSERT_THAT(rows, SizeIs(1));
  RowEstimate estimate;
  estimate.positions.assign(6, Position{10, 5});
  estimate.visibility_logit = {0, 1, 2, 3, 4, 5};
  estimate.similarity = {1, 0.9f, 0.8f, 0.7f, 0.6f, 0.5f};
  estimate.last_step = {0, 0.1f, 0.2f, 0.3f, 0.4f, 0.5f};
  harness.tracks().Apply(rows[0], estimate);
  ASSERT_EQ(harness.HeardFrames(1), FramesFrom(1, 3));
  for (const Heard& heard : harness.heard()) {
    EXPECT_EQ(heard.evidence.visibility_logit, estimate.visibility_logit[heard.frame]);
    EXPECT_EQ(heard.evidence.similarity, Coarse(estimate.similarity[heard.frame]));
    EXPECT_EQ(heard.evidence.last_step, Coarse(estimate.last_step[heard.frame]));
  }
}

TEST(TrackSetTest, OfARemovedPointTheSinkHearsWhatIsReported) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.FramesAndRun(1);
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 25));
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 25));
}

TEST(TrackSetTest, OfAReSeededPointTheSinkHearsNothingOfTheSecondQuery) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  for (int i = 0; i < 23; ++i) harness.Frame();
  harness.Seed(1, 320);  // on frame 23, of which the first window has an estimate of the old track
  for (int i = 0; i < 10; ++i) harness.Frame();
  harness.RunDue();  // the old track ends
  harness.Finish();
  std::vector<int64_t> expected = FramesFrom(1, 33);
  expected.erase(std::find(expected.begin(), expected.end(), 23));
  EXPECT_EQ(harness.HeardFrames(1), expected);
  EXPECT_EQ(harness.heard().back().evidence.age, 10);
}

TEST(TrackSetTest, WithPolishTheSinkHearsOfAFrameWhenItIsPolishedWithTheOutcome) {
  const auto outcome = [](int64_t frame) {
    return frame % 3 == 0   ? Evidence::Polish::kFromQuery
           : frame % 3 == 1 ? Evidence::Polish::kFromBefore
                            : Evidence::Polish::kNotFound;
  };
  TrackSetHarness harness({24, 8, /*early=*/true, /*polish=*/true});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(31);  // the windows up to frame 23 and frame 31
  EXPECT_THAT(harness.heard(), IsEmpty());
  harness.Polish(outcome);
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 16));
  harness.FramesAndRun(8);
  harness.RunDue(/*ended=*/true);
  harness.tracks().FinalizeAll();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 16));
  harness.Polish(outcome);
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 39));
  for (const Heard& heard : harness.heard()) EXPECT_EQ(heard.evidence.polish, outcome(heard.frame)) << heard.frame;
  harness.Finish();
  EXPECT_THAT(harness.heard(), SizeIs(39));
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(40));
}

TEST(TrackSetTest, OfARemovedPointThatWaitsForPolishTheSinkHearsAfterwards) {
  TrackSetHarness harness({24, 8, /*early=*/true, /*polish=*/true});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.FramesAndRun(1);
  EXPECT_THAT(harness.heard(), IsEmpty());
  harness.Polish(kAllFromQuery);
  harness.RunDue();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 25));
  EXPECT_EQ(harness.tracks().tracks(), 0);
  harness.Finish();
  EXPECT_THAT(harness.heard(), SizeIs(25));
}

TEST(TrackSetTest, ACalibrationMayTrustWhatTheNetworkDoesNot) {
  const Calibration trusting = ThreeQuartersBy(kConstant);
  TrackSetHarness harness({24, 8, /*early=*/true, /*polish=*/true}, /*provisional=*/true, &trusting);
  harness.model().similarity = 0.3f;  // a confidence of 1/4 by the network's word
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(23);
  const std::vector<PointTrack*> waiting = harness.tracks().Unpolished();
  ASSERT_THAT(waiting, SizeIs(1));
  EXPECT_THAT(waiting[0]->unpolished().visible, ElementsAre(0, 0, 0, 0, 0, 0, 0, 0));
  harness.Polish(kAllFromQuery);
  const auto verdicts = FinalVerdicts(harness.runs(), 1);
  ASSERT_THAT(verdicts, SizeIs(9));
  EXPECT_EQ(verdicts.at(0).confidence, 1) << "the query is certain";
  for (int64_t frame = 1; frame <= 8; ++frame) {
    EXPECT_FLOAT_EQ(verdicts.at(frame).confidence, 0.75f);
    EXPECT_TRUE(verdicts.at(frame).visible);
  }
}

TEST(TrackSetTest, ACalibrationMayDoubtWhatTheNetworkDoesNot) {
  const Calibration doubting({-std::log(19.0)});
  TrackSetHarness harness({24, 8, /*early=*/true, /*polish=*/true}, /*provisional=*/true, &doubting);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(23);
  ASSERT_THAT(harness.tracks().Unpolished(), SizeIs(1));
  EXPECT_THAT(harness.tracks().Unpolished()[0]->unpolished().visible, ElementsAre(1, 1, 1, 1, 1, 1, 1, 1));
  harness.Polish(kAllFromQuery);
  harness.FramesAndRun(8);
  ASSERT_THAT(harness.tracks().Unpolished(), SizeIs(1));
  EXPECT_TRUE(harness.tracks().Unpolished()[0]->unpolished().previous.has_value())
      << "polish goes on from what the network saw";
  for (const auto& [frame, verdict] : FinalVerdicts(harness.runs(), 1)) {
    EXPECT_FLOAT_EQ(verdict.confidence, frame == 0 ? 1 : 0.05f);
    EXPECT_EQ(verdict.visible, frame == 0);
  }
}

TEST(TrackSetTest, NoCalibrationMakesAPointVisibleOutsideTheFrame) {
  const Calibration trusting = ThreeQuartersBy(kConstant);
  TrackSetHarness harness({24, 8}, /*provisional=*/true, &trusting);
  harness.Frame();
  harness.Seed(1, 600);
  harness.FramesAndRun(7);
  EXPECT_THAT(harness.runs()[0].visible, ElementsAre(1, 1, 1, 1, 1, 0, 0, 0));
  EXPECT_FLOAT_EQ(harness.runs()[0].confidence[7], 0.75f);
}

TEST(TrackSetTest, ThePolishOutcomeCountsInTheFinalConfidence) {
  Calibration::Features weights{-std::log(19.0)};
  weights[kFoundFromQuery] = std::log(19.0) + std::log(3.0);
  const Calibration by_outcome(weights);
  TrackSetHarness harness({24, 8, /*early=*/false, /*polish=*/true}, /*provisional=*/true, &by_outcome);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(23);
  harness.Polish(
      [](int64_t frame) { return frame % 2 == 0 ? Evidence::Polish::kFromQuery : Evidence::Polish::kNotFound; });
  for (const auto& [frame, verdict] : FinalVerdicts(harness.runs(), 1)) {
    if (frame == 0) continue;
    EXPECT_FLOAT_EQ(verdict.confidence, frame % 2 == 0 ? 0.75f : 0.05f) << frame;
    EXPECT_EQ(verdict.visible, frame % 2 == 0) << frame;
  }
  ASSERT_THAT(harness.runs(), SizeIs(1));
  const PointRun& run = harness.runs().front();
  ASSERT_THAT(run.confidence, SizeIs(24));
  EXPECT_THAT(std::vector<float>(run.confidence.begin() + run.final_count, run.confidence.end()), Each(FloatEq(0.05f)))
      << "provisional ones are not polished";
}

TEST(TrackSetTest, APointThatIsPolishedOutOfTheFrameIsNotVisible) {
  TrackSetHarness harness({24, 8, /*early=*/false, /*polish=*/true});
  harness.model().step = 0;
  harness.Frame();
  harness.Seed(1, 630);
  harness.FramesAndRun(23);
  harness.Polish(kAllFromQuery, /*move=*/1);  // 16 pixels of the frame
  const auto verdicts = FinalVerdicts(harness.runs(), 1);
  ASSERT_THAT(verdicts, SizeIs(9));
  EXPECT_TRUE(verdicts.at(0).visible);
  EXPECT_FALSE(verdicts.at(8).visible);
  EXPECT_EQ(verdicts.at(8).confidence, 1);
}

// With the largest hop a window's newest frame is final, and polished, when the next one begins; a session that is
// resumed then has to doubt the same points.
TEST(TrackSetTest, WhetherAPointIsLostIsJudgedAlikeBeforeAndAfterPolish) {
  WindowOptions windows{24, 23};
  windows.polish = true;
  Calibration::Features weights{};
  weights[kFoundFromQuery] = 2;
  const Calibration calibration(weights);
  TrackSetHarness harness(windows, /*provisional=*/true, &calibration);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(24);
  const PointTrack& track = *harness.tracks().all().front();
  const float before = track.newest_assurance(), confidence = track.newest_confidence();
  harness.Polish(kAllFromQuery);
  EXPECT_GT(track.newest_confidence(), confidence);
  EXPECT_EQ(track.newest_assurance(), before);
  const PointTrack resumed(track.state(), windows, {&calibration}, harness.tracks().geometry());
  EXPECT_EQ(resumed.newest_assurance(), before);
}

// Windows end on frames 23, 31, 39 and so on.
TEST(TrackSetTest, APointThatStaysLostIsLookedForLessOften) {
  TrackSetHarness harness({24, 8});
  harness.model().similarity = 0.2f;
  harness.Frame();
  harness.Seed(1);
  const PointTrack& track = *harness.tracks().all().front();
  EXPECT_EQ(track.newest_assurance(), 1) << "of the query itself";
  EXPECT_TRUE(track.worth_a_search());
  harness.FramesAndRun(23);
  EXPECT_LT(track.newest_assurance(), kDoubtBelow);
  std::vector<bool> searched;
  for (int window = 1; window < 17; ++window) {
    searched.push_back(track.worth_a_search());
    harness.FramesAndRun(8);
  }
  EXPECT_THAT(searched, ElementsAre(true, true, true, true, true, true, true, true, false, false, false, true, false,
                                    false, false, true));
  const TrackState state = track.state();
  EXPECT_EQ(state.lost_windows, 17);
  const PointTrack resumed(state, {24, 8}, {}, harness.tracks().geometry());
  EXPECT_EQ(resumed.worth_a_search(), track.worth_a_search());
  EXPECT_EQ(resumed.newest_assurance(), track.newest_assurance());
  harness.model().similarity = 1;
  harness.FramesAndRun(8);
  EXPECT_EQ(track.state().lost_windows, 0);
}

}  // namespace
}  // namespace holdfast
