// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/track_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <numeric>
#include <vector>

#include "tests/server/engine/tracks/track_set_harness.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::SizeIs;

TEST(TrackSetTest, ReportsALineThroughTheQueryInPixelsOfTheFrame) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160, 80);
  harness.FramesAndRun(39);
  harness.Finish();
  const auto finals = FinalX(harness.runs(), 1);
  ASSERT_THAT(finals, SizeIs(40));
  for (const auto& [frame, x] : finals) EXPECT_FLOAT_EQ(x, 160 + 8.0f * frame);  // half a feature pixel a frame
}

TEST(TrackSetTest, GivesAnEarlyEstimateWhoseOnlyFinalFrameIsTheQuery) {
  TrackSetHarness harness({24, 8});
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
  TrackSetHarness harness({6, 3});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(2);
  EXPECT_THAT(harness.used(), ElementsAre(0, 1, 2, 2, 2, 2));
}

TEST(TrackSetTest, EarlyWindowsLeaveNoTraceInWhatBecomesFinal) {
  TrackSetHarness with({24, 8, /*early=*/true}), without({24, 8, /*early=*/false}, /*provisional=*/false);
  for (TrackSetHarness* harness : {&with, &without}) {
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
  TrackSetHarness harness({24, 8, false}, /*provisional=*/false);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(50);
  harness.Finish();
  for (const PointRun& run : harness.runs()) EXPECT_EQ(run.final_count, static_cast<int64_t>(run.x.size()));
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(51));
}

TEST(TrackSetTest, NeverRevisesAFinalFrame) {
  TrackSetHarness harness({24, 8});
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

TEST(TrackSetTest, ARemovedPointHasAFinalEstimateOnEveryFrameUpToItsRemoval) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.Seed(2);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.tracks().Remove(99, 25);
  harness.RunDue();
  EXPECT_EQ(FinalX(harness.runs(), 1).rbegin()->first, 8) << "it may be added again at frame 25";
  harness.FramesAndRun(1);
  EXPECT_EQ(FinalX(harness.runs(), 1).rbegin()->first, 25);
  harness.FramesAndRun(30);
  harness.Finish();
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(26));
  EXPECT_THAT(FinalX(harness.runs(), 2), SizeIs(57));
}

TEST(TrackSetTest, WhatARemovedPointEndsWithDoesNotDependOnThePace) {
  TrackSetHarness prompt({24, 8}), late({24, 8});
  for (TrackSetHarness* harness : {&prompt, &late}) {
    harness->Frame();
    harness->Seed(1);
  }
  prompt.FramesAndRun(33);
  prompt.tracks().Remove(1, 33);
  prompt.FramesAndRun(1);
  for (int i = 0; i < 33; ++i) late.Frame();
  late.tracks().Remove(1, 33);
  for (int i = 0; i < 30; ++i) late.Frame();
  late.RunDue();
  EXPECT_EQ(FinalX(prompt.runs(), 1), FinalX(late.runs(), 1));
  EXPECT_EQ(FinalX(late.runs(), 1).rbegin()->first, 33);
}

TEST(TrackSetTest, WhatARemovedPointEndsWithDoesNotDependOnProvisionalWindows) {
  for (const int64_t frames : {2, 9, 20, 24, 25}) {
    TrackSetHarness provisional({24, 8}), final_only({24, 8, /*early=*/false}, /*provisional=*/false);
    for (TrackSetHarness* harness : {&provisional, &final_only}) {
      harness->Frame();
      harness->Seed(1);
      harness->FramesAndRun(static_cast<int>(frames) - 1);
      harness->tracks().Remove(1, frames - 1);
      harness->FramesAndRun(40);
      harness->Finish();
      EXPECT_THAT(FinalX(harness->runs(), 1), SizeIs(static_cast<size_t>(frames)));
    }
    EXPECT_EQ(FinalX(provisional.runs(), 1), FinalX(final_only.runs(), 1)) << frames;
  }
}

TEST(TrackSetTest, APointThatIsReSeededOnceFramesWereForgottenEndsWell) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(50);  // all that is older than 24 frames is forgotten
  harness.Seed(1, 320);
  harness.RunDue();
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(50));
}

TEST(TrackSetTest, APointThatIsRemovedOnTheLastFrameIsFinalUpToIt) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(25);
  harness.tracks().Remove(1, 25);
  harness.RunDue();
  harness.Finish();
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(26));
}

TEST(TrackSetTest, FramesStayForTheLastWindowOfAPointThatEnds) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(38);
  harness.tracks().Remove(1, 38);
  for (int i = 0; i < 20; ++i) {
    harness.Frame();
    harness.tracks().Evict();
    EXPECT_LE(harness.tracks().cache().oldest(), 38 - 23);
  }
  harness.RunDue();
  harness.tracks().TakeEnded();
  harness.tracks().Evict();
  EXPECT_EQ(harness.tracks().cache().oldest(), 38 + 20 - 23);
}

TEST(TrackSetTest, ReSeedingEndsTheOldTrackBeforeTheNewOneStarts) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  for (int i = 0; i < 30; ++i) harness.Frame();
  harness.Seed(1, 320);
  for (int i = 0; i < 30; ++i) harness.Frame();
  harness.RunDue();  // the old track ends
  harness.Finish();
  std::vector<int64_t> firsts;
  bool new_track = false;
  for (const PointRun& run : harness.runs()) {
    if (run.first_frame >= 30) new_track = true;
    EXPECT_EQ(run.first_frame >= 30, new_track) << "runs of the two tracks are mixed";
    if (run.first_frame < 30) {
      EXPECT_LE(run.first_frame + static_cast<int64_t>(run.x.size()), 30);
    }
    if (run.first_frame == 30) {
      EXPECT_EQ(run.x[0], 320.0f);
    }
  }
  EXPECT_TRUE(new_track);
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(61)) << "no frame is left out where one follows the other";
}

TEST(TrackSetTest, ReSeedingOnTheVeryFrameOfTheQueryReportsOnlyTheNewTrack) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  harness.Seed(1, 320);
  harness.Finish();
  ASSERT_THAT(harness.runs(), SizeIs(1));
  EXPECT_THAT(harness.runs()[0].x, ElementsAre(320.0f));
}

// As where a detector says anew on every frame where its points are.
TEST(TrackSetTest, NoWindowRunsForATrackOfWhichEverythingIsFinal) {
  TrackSetHarness harness({24, 8, /*early=*/false});
  for (int frame = 0; frame < 30; ++frame) {
    harness.Frame();
    harness.Seed(1, 160.0f + static_cast<float>(frame));
    harness.RunDue();
  }
  EXPECT_EQ(harness.model().counts()->rows, 0);
  EXPECT_THAT(FinalX(harness.runs(), 1), SizeIs(29));
}

TEST(TrackSetTest, WhatIsNotReportedIsNotPolished) {
  WindowOptions windows{24, 8, /*early=*/false};
  windows.polish = true;
  TrackSetHarness harness(windows);
  harness.Frame();
  harness.Seed(1);
  harness.FramesAndRun(5);
  harness.Seed(1, 320);
  harness.RunDue();
  ASSERT_THAT(harness.tracks().Unpolished(), SizeIs(1));
  const PointTrack::Unpolished unpolished = harness.tracks().Unpolished()[0]->unpolished();
  EXPECT_EQ(unpolished.first, 1);
  EXPECT_THAT(unpolished.positions, SizeIs(4)) << "frame 5 is the new track's";
}

// In the order in which they were reported.
std::vector<int64_t> FinalFrames(const std::vector<PointRun>& runs) {
  std::vector<int64_t> finals;
  for (const PointRun& run : runs) {
    for (int64_t i = 0; i < run.final_count; ++i) finals.push_back(run.first_frame + i);
  }
  return finals;
}

TEST(TrackSetTest, AFrameAtWhichAPointIsRemovedAndAddedAgainIsTheNewTracks) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  for (int i = 1; i < 24; ++i) harness.Frame();  // the window that ends here has an estimate of this very frame
  harness.tracks().Remove(1, 23);
  harness.RunDue();
  harness.Seed(1, 320);
  harness.FramesAndRun(8);
  harness.Finish();
  std::vector<int64_t> each_once(32);
  std::iota(each_once.begin(), each_once.end(), 0);
  EXPECT_EQ(FinalFrames(harness.runs()), each_once);
  EXPECT_EQ(FinalX(harness.runs(), 1).at(23), 320.0f);
}

TEST(TrackSetTest, ARemovalHoldsThoughTheIdIsUsedAgainLater) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 160);
  for (int i = 1; i < 30; ++i) harness.Frame();
  harness.tracks().Remove(1, 25);
  for (int i = 30; i < 40; ++i) harness.Frame();
  harness.Seed(1, 320);
  harness.Finish();
  std::vector<int64_t> expected(26);  // the window up to frame 31 is not the removed track's
  std::iota(expected.begin(), expected.end(), 0);
  expected.push_back(39);
  EXPECT_EQ(FinalFrames(harness.runs()), expected);
}

TEST(TrackSetTest, OutsideTheFrameAPointIsNotVisible) {
  TrackSetHarness harness({24, 8});
  harness.Frame();
  harness.Seed(1, 600);
  harness.FramesAndRun(7);
  // 8 pixels a frame: 639.5 is the end of the last pixel.
  EXPECT_THAT(harness.runs()[0].visible, ElementsAre(1, 1, 1, 1, 1, 0, 0, 0));
}

TEST(TrackSetTest, KeepsFramesForAWindowAndAHopHoweverLongTheVideo) {
  TrackSetHarness harness({24, 8});
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
  TrackSetHarness harness({24, 8});
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
  TrackSetHarness harness({24, 8});
  harness.FramesAndRun(100);
  EXPECT_EQ(harness.tracks().cache().size(), 24);
}

TEST(TrackSetTest, GroupsRowsInTheOrderOfTheirWindows) {
  TrackSetHarness harness({6, 2, false});
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
      TrackSetHarness harness({24, GetParam(), provisional}, provisional);
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

TEST_P(EveryHopAndLength, AFrameAtWhichAPointIsQueriedAnewIsFinalOnce) {
  for (const bool provisional : {true, false}) {
    for (const int64_t anew : {1, 2, 22, 23, 24, 31, 46}) {  // after the windows that this frame makes due
      TrackSetHarness harness({24, GetParam(), provisional}, provisional);
      harness.Frame();
      harness.Seed(1, 160);
      harness.FramesAndRun(anew);
      harness.Seed(1, 320);
      harness.RunDue();
      harness.FramesAndRun(30);
      harness.Finish();
      const auto finals = FinalX(harness.runs(), 1);
      ASSERT_THAT(finals, SizeIs(anew + 31));
      EXPECT_FLOAT_EQ(finals.at(anew), 320);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Hops, EveryHopAndLength, ::testing::Range(1, 24));

}  // namespace
}  // namespace holdfast
