// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/track_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/fake_tracker_model.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::FloatEq;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// What the sink was told.
struct Heard {
  PointId id = 0;
  int64_t frame = 0;
  Evidence evidence;
};

// A session without threads: frames arrive, whatever is due runs, runs are collected.
class Harness {
 public:
  explicit Harness(WindowOptions windows, bool provisional = true, const Calibration* calibration = nullptr)
      : sink_([this](PointId id, int64_t frame, const Evidence& evidence) {
          heard_.push_back({id, frame, evidence});
        }),
        tracks_(windows, provisional, {calibration, &sink_}) {
    tracks_.SetGeometry(FrameGeometry({640, 320}, {320, 160}, 8));  // a feature pixel is 16 pixels of the frame
  }
  TrackSet& tracks() { return tracks_; }
  FakeTrackerModel& model() { return model_; }

  void Frame() {
    const RgbImage image{{1, 1}, {static_cast<uint8_t>(frames_++), 0, 0}};
    const RgbImage* images[] = {&image};
    tracks_.AddFrame(model_.Encode(images).front());
  }
  void Seed(PointId id, float x = 160, float y = 80) {
    const Position at = tracks_.geometry().ToFeatures(x, y);
    const auto feature = model_.Sample(*tracks_.cache().At(frames_ - 1), {&at, 1}).front();
    tracks_.Seed({seeds_++, {id, x, y}, frames_ - 1, at, feature});
  }
  void RunDue(bool ended = false) {
    for (auto rows = tracks_.Due(ended); !rows.empty(); rows = tracks_.Due(ended)) {
      for (const DueRow& row : rows) {
        const WindowGroup group = tracks_.Group({&row, 1});
        for (const auto& frame : group.frames) used_.push_back(FakeTrackerModel::ValueOf(*frame));
        Collect(tracks_.Apply(row, model_.Refine({&group, 1}, {}).front()));
      }
    }
    Collect(tracks_.TakeEnded());
    tracks_.Evict();
  }
  void FramesAndRun(int64_t count) {
    for (int64_t i = 0; i < count; ++i) {
      Frame();
      RunDue();
    }
  }
  void Finish() {
    RunDue(/*ended=*/true);
    Collect(tracks_.FinishAll());
  }
  // Polishes whatever waits for it; the pictures say 'outcome' of each frame that is not hidden, and move it by 'move'
  // feature pixels to the right.
  void Polish(const std::function<Evidence::Polish(int64_t frame)>& outcome, float move = 0) {
    for (PointTrack* track : tracks_.Unpolished()) {
      const PointTrack::Unpolished given = track->unpolished();
      std::vector<PointTrack::Polished> polished;
      for (size_t i = 0; i < given.positions.size(); ++i) {
        const Position at = given.positions[i];
        if (given.visible[i] != 0) {
          polished.push_back({{at.x + move, at.y}, outcome(given.first + static_cast<int64_t>(i))});
        } else {
          polished.push_back({at, Evidence::Polish::kNotTried});
        }
      }
      Collect(tracks_.Polish(*track, polished));
    }
  }
  // The frames the sink heard of.
  std::vector<int64_t> HeardFrames(PointId id) const {
    std::vector<int64_t> frames;
    for (const Heard& heard : heard_) {
      if (heard.id == id) frames.push_back(heard.frame);
    }
    return frames;
  }
  const std::vector<Heard>& heard() const { return heard_; }
  const std::vector<PointRun>& runs() const { return runs_; }
  const std::vector<int>& used() const { return used_; }

 private:
  void Collect(std::vector<PointRun> runs) {
    for (PointRun& run : runs) runs_.push_back(std::move(run));
  }
  void Collect(std::optional<PointRun> run) {
    if (run) runs_.push_back(*std::move(run));
  }
  FakeTrackerModel model_;
  std::vector<Heard> heard_;
  const EvidenceSink sink_;
  TrackSet tracks_;
  int64_t frames_ = 0;
  uint64_t seeds_ = 0;
  std::vector<PointRun> runs_;
  std::vector<int> used_;  // values of the frames refined on
};

// Checks that runs are well-formed and every frame becomes final once, in order; the final x by frame.
std::map<int64_t, float> FinalX(const std::vector<PointRun>& runs, PointId id) {
  std::map<int64_t, float> finals;
  for (const PointRun& run : runs) {
    if (run.id != id) continue;
    EXPECT_THAT(run.y, SizeIs(run.x.size()));
    EXPECT_THAT(run.visible, SizeIs(run.x.size()));
    EXPECT_THAT(run.confidence, SizeIs(run.x.size()));
    EXPECT_LE(run.final_count, static_cast<int64_t>(run.x.size()));
    if (!finals.empty()) {
      EXPECT_EQ(run.first_frame, finals.rbegin()->first + 1);
    }
    for (int64_t i = 0; i < run.final_count; ++i) {
      EXPECT_TRUE(finals.emplace(run.first_frame + i, run.x[i]).second) << "final twice";
    }
  }
  return finals;
}

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

std::vector<int64_t> FramesFrom(int64_t first, int64_t last) {
  std::vector<int64_t> frames(static_cast<size_t>(last - first + 1));
  std::iota(frames.begin(), frames.end(), first);
  return frames;
}

// Of confidence 3/4 where the feature is 1 and nothing else counts.
Calibration ThreeQuartersBy(size_t feature) {
  Calibration::Features weights{};
  weights[feature] = std::log(3.0);
  return Calibration(weights);
}
constexpr size_t kConstant = 0, kFoundFromQuery = 6;

const auto kAllFromQuery = [](int64_t) { return Evidence::Polish::kFromQuery; };

TEST(TrackSetTest, ReportsALineThroughTheQueryInPixelsOfTheFrame) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160, 80);
  harness.FramesAndRun(39);
  harness.Finish();
  const auto finals = FinalX(harness.runs(), 1);
  ASSERT_THAT(finals, SizeIs(40));
  for (const auto& [frame, x] : finals) EXPECT_FLOAT_EQ(x, 160 + 8.0f * frame);  // half a feature pixel a frame
}

TEST(TrackSetTest, GivesAnEarlyEstimateWhoseOnlyFinalFrameIsTheQuery) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 161.3f, 80.7f);
  harness.FramesAndRun(7);
  ASSERT_THAT(harness.runs(), SizeIs(1));
  const PointRun& run = harness.runs().front();
  EXPECT_EQ(run.first_frame, 0);
  EXPECT_EQ(run.final_count, 1);
  EXPECT_THAT(run.x, SizeIs(8));
  EXPECT_EQ(run.x[0], 161.3f);  // to the bit
  EXPECT_EQ(run.y[0], 80.7f);
  EXPECT_EQ(run.confidence[0], 1.0f);
}

TEST(TrackSetTest, FillsAnEarlyWindowWithTheNewestFrame) {
  Harness harness({6, 3});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(2);
  EXPECT_THAT(harness.used(), ElementsAre(0, 1, 2, 2, 2, 2));
}

TEST(TrackSetTest, EarlyWindowsLeaveNoTraceInWhatBecomesFinal) {
  Harness with({24, 8, /*early=*/true}), without({24, 8, /*early=*/false}, /*provisional=*/false);
  for (Harness* harness : {&with, &without}) {
    harness->Frame();
    harness->Seed(1);
    harness->FramesAndRun(20);
    harness->model().step = 0.25f;  // what the early windows found is not what the full window finds
    harness->FramesAndRun(30);
    harness->Finish();
  }
  EXPECT_EQ(FinalX(with.runs(), 1), FinalX(without.runs(), 1));
}

TEST(TrackSetTest, WithoutProvisionalResultsSendsOnlyFinalFrames) {
  Harness harness({24, 8, false}, /*provisional=*/false);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(50);
  harness.Finish();
  for (const PointRun& run : harness.runs()) EXPECT_EQ(run.final_count, static_cast<int64_t>(run.x.size()));
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(51));
}

TEST(TrackSetTest, NeverRevisesAFinalFrame) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(23);  // the first window: frames 0 .. 8 are final
  harness.model().step = 0.25f;
  harness.FramesAndRun(3);
  harness.Finish();  // the last window: frames 3 .. 26
  const auto finals = FinalX(harness.runs(), 1);
  EXPECT_FLOAT_EQ(finals.at(8), 160 + 8 * 8.0f);
  EXPECT_FLOAT_EQ(finals.at(26), 160 + 3 * 8.0f + 23 * 4.0f);  // from the locked frame 3 on
}

TEST(TrackSetTest, EndsARemovedPointWithItsEstimatesAsTheyStand) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.Seed(2);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.tracks().Remove(99, 25);
  harness.RunDue();
  EXPECT_EQ(FinalX(harness.runs(), 1).rbegin()->first, 23);  // the newest estimate
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(24));
  EXPECT_THAT(FinalX(harness.runs(), 2), SizeIs(56));
}

TEST(TrackSetTest, WhatARemovedPointEndsWithDoesNotDependOnThePace) {
  Harness prompt({24, 8}), late({24, 8});
  for (Harness* harness : {&prompt, &late}) {
    harness->Frame();
    harness->Seed(1);
  }
  prompt.FramesAndRun(33);
  prompt.tracks().Remove(1, 33);
  prompt.RunDue();
  for (int i = 0; i < 33; ++i) late.Frame();
  late.tracks().Remove(1, 33);
  for (int i = 0; i < 30; ++i) late.Frame();
  late.RunDue();
  EXPECT_EQ(FinalX(prompt.runs(), 1), FinalX(late.runs(), 1));
  EXPECT_EQ(FinalX(late.runs(), 1).rbegin()->first, 31);
}

TEST(TrackSetTest, ReSeedingEndsTheOldTrackBeforeTheNewOneStarts) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  for (int i = 0; i < 30; ++i) harness.Frame();
  harness.Seed(1, 320);
  for (int i = 0; i < 30; ++i) harness.Frame();
  harness.Finish();
  // The new track begins on frame 30: frames 24 .. 29 have no estimate of the old one, whose window ended on 23.
  std::vector<int64_t> firsts;
  bool new_track = false;
  for (const PointRun& run : harness.runs()) {
    if (run.first_frame >= 30) new_track = true;
    EXPECT_EQ(run.first_frame >= 30, new_track) << "runs of the two tracks are mixed";
    if (run.first_frame < 30) {
      EXPECT_LE(run.first_frame + static_cast<int64_t>(run.x.size()), 24);
    }
    if (run.first_frame == 30) {
      EXPECT_EQ(run.x[0], 320.0f);
    }
  }
  EXPECT_TRUE(new_track);
}

TEST(TrackSetTest, ReSeedingOnTheVeryFrameOfTheQueryReportsOnlyTheNewTrack) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  harness.Seed(1, 320);
  harness.Finish();
  ASSERT_THAT(harness.runs(), SizeIs(1));
  EXPECT_THAT(harness.runs()[0].x, ElementsAre(320.0f));
}

TEST(TrackSetTest, OutsideTheFrameAPointIsNotVisible) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 600);
  harness.FramesAndRun(7);
  // 8 pixels a frame: 639.5 is the end of the last pixel.
  EXPECT_THAT(harness.runs()[0].visible, ElementsAre(1, 1, 1, 1, 1, 0, 0, 0));
}

TEST(TrackSetTest, KeepsFramesForAWindowAndAHopHoweverLongTheVideo) {
  Harness harness({24, 8});
  harness.Frame();
  for (PointId id = 0; id < 5; ++id) harness.Seed(id);
  harness.FramesAndRun(200);
  const int64_t after_200 = harness.model().counts()->max_alive;
  EXPECT_LE(after_200, 25);
  harness.FramesAndRun(1800);
  EXPECT_EQ(harness.model().counts()->max_alive, after_200);
  EXPECT_EQ(harness.tracks().cache().bytes(), harness.tracks().cache().size() * FakeTrackerModel::kFrameBytes);
}

TEST(TrackSetTest, AWindowThatIsDueKeepsItsFrames) {
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  for (int i = 0; i < 50; ++i) {
    harness.Frame();
    harness.tracks().Evict();
  }
  EXPECT_EQ(harness.tracks().cache().oldest(), 0);
  harness.RunDue();
  EXPECT_EQ(harness.tracks().cache().oldest(), 27);
}

TEST(TrackSetTest, KeepsTheFramesOfAWindowForTheEndOfTheStreamWithoutAnyPoint) {
  Harness harness({24, 8});
  harness.FramesAndRun(100);
  EXPECT_EQ(harness.tracks().cache().size(), 24);
}

TEST(TrackSetTest, GroupsRowsInTheOrderOfTheirWindows) {
  Harness harness({6, 2, false});
  harness.Frame();
  harness.Seed(1);
  harness.Frame();
  harness.Seed(2);
  harness.Seed(3);
  for (int i = 0; i < 10; ++i) harness.Frame();
  std::vector<int64_t> firsts;
  for (const DueRow& row : harness.tracks().Due(false)) firsts.push_back(row.plan.first);
  EXPECT_THAT(firsts, ElementsAre(0, 1, 1));
}

TEST(TrackSetTest, TheSinkHearsOfEachFrameOnceWhenItBecomesFinalButNotOfTheQuery) {
  Harness harness({24, 8});
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
  Harness harness({24, 8});
  for (int i = 0; i < 6; ++i) harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(6, 35));
  for (const Heard& heard : harness.heard()) EXPECT_EQ(heard.evidence.age, heard.frame - 5);
}

TEST(TrackSetTest, TheSinkHearsTheLogitOfTheEstimateThatBecomesFinal) {
  Harness harness({6, 3, /*early=*/false});
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
  Harness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.RunDue();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 23));
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 23));
}

TEST(TrackSetTest, OfAReSeededPointTheSinkHearsNothingOfTheSecondQuery) {
  Harness harness({24, 8});
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
  Harness harness({24, 8, /*early=*/true, /*polish=*/true});
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
  Harness harness({24, 8, /*early=*/true, /*polish=*/true});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.RunDue();
  EXPECT_THAT(harness.heard(), IsEmpty());
  harness.Polish(kAllFromQuery);
  harness.RunDue();
  EXPECT_EQ(harness.HeardFrames(1), FramesFrom(1, 23));
  EXPECT_EQ(harness.tracks().tracks(), 0);
  harness.Finish();
  EXPECT_THAT(harness.heard(), SizeIs(23));
}

TEST(TrackSetTest, ACalibrationMayTrustWhatTheNetworkDoesNot) {
  const Calibration trusting = ThreeQuartersBy(kConstant);
  Harness harness({24, 8, /*early=*/true, /*polish=*/true}, /*provisional=*/true, &trusting);
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
  Harness harness({24, 8, /*early=*/true, /*polish=*/true}, /*provisional=*/true, &doubting);
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
  Harness harness({24, 8}, /*provisional=*/true, &trusting);
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
  Harness harness({24, 8, /*early=*/false, /*polish=*/true}, /*provisional=*/true, &by_outcome);
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
  Harness harness({24, 8, /*early=*/false, /*polish=*/true});
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

class EveryHopAndLength : public ::testing::TestWithParam<int> {};

TEST_P(EveryHopAndLength, MakesEveryFrameOfEveryPointFinalOnceOnItsLine) {
  for (const bool provisional : {true, false}) {
    for (const int64_t frames : {1, 2, 7, 23, 24, 25, 47, 48, 61}) {
      Harness harness({24, GetParam(), provisional}, provisional);
      std::map<PointId, int64_t> queried;
      for (int64_t frame = 0; frame < frames; ++frame) {
        harness.Frame();
        if (frame % 5 == 0) {
          harness.Seed(static_cast<PointId>(frame));
          queried[static_cast<PointId>(frame)] = frame;
        }
        harness.RunDue();
      }
      harness.Finish();
      for (const auto& [id, query] : queried) {
        const auto finals = FinalX(harness.runs(), id);
        ASSERT_THAT(finals, SizeIs(frames - query));
        EXPECT_EQ(finals.begin()->first, query);
        for (const auto& [frame, x] : finals) EXPECT_FLOAT_EQ(x, 160 + 8.0f * (frame - query));
        EXPECT_EQ(harness.HeardFrames(id), FramesFrom(query + 1, frames - 1));
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Hops, EveryHopAndLength, ::testing::Range(1, 24));

}  // namespace
}  // namespace holdfast
