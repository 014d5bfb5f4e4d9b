// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/track_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "tests/support/fake_tracker_model.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::SizeIs;

// A session without threads: frames arrive, whatever is due runs, runs are collected.
class Harness {
 public:
  explicit Harness(WindowOptions windows, bool provisional = true) : tracks_(windows, provisional) {
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
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Hops, EveryHopAndLength, ::testing::Range(1, 24));

}  // namespace
}  // namespace holdfast
