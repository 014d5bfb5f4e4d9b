// SPDX-License-Identifier: Apache-2.0
#include "client/final_filter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// A run of frames first .. first + length - 1 whose x are the frames.
PointRun Estimates(PointId id, int64_t first, int64_t length, int64_t final_count) {
  PointRun run;
  run.id = id;
  run.first_frame = first;
  run.final_count = final_count;
  for (int64_t i = 0; i < length; ++i) {
    run.x.push_back(static_cast<float>(first + i));
    run.y.push_back(static_cast<float>(first + i));
    run.visible.push_back(1);
    run.confidence.push_back(1);
  }
  return run;
}

TrackUpdate Update(std::vector<PointRun> runs, int64_t received = 0, int64_t processed = 0) {
  TrackUpdate update;
  update.runs = std::move(runs);
  update.frames_received = received;
  update.frames_processed = processed;
  return update;
}

// "id: first..last (final_count)" of what is left of the runs, which are checked to be whole.
std::vector<std::string> Left(FinalFilter& filter, TrackUpdate update) {
  filter.Apply(update);
  std::vector<std::string> left;
  for (const PointRun& run : update.runs) {
    EXPECT_EQ(run.y.size(), run.x.size());
    EXPECT_EQ(run.visible.size(), run.x.size());
    EXPECT_EQ(run.confidence.size(), run.x.size());
    EXPECT_EQ(run.x.front(), run.first_frame);
    left.push_back(absl::StrCat(run.id, ": ", run.first_frame, "..", run.x.back(), " (", run.final_count, ")"));
  }
  return left;
}

TEST(FinalFilterTest, WithoutALossNothingIsTouched) {
  FinalFilter filter;
  EXPECT_THAT(Left(filter, Update({Estimates(1, 0, 8, 4)})), ElementsAre("1: 0..7 (4)"));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 4, 8, 4)})), ElementsAre("1: 4..11 (4)"));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 7, 8, 0)})), ElementsAre("1: 7..14 (0)"));
}

TEST(FinalFilterTest, WhatComesAgainIsCutAtTheFirstNewFrame) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 10, 6), Estimates(2, 3, 2, 2)}));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 2, 3, 3)})), IsEmpty());
  EXPECT_THAT(Left(filter, Update({Estimates(1, 4, 6, 4), Estimates(2, 4, 3, 1), Estimates(3, 0, 2, 1)})),
              ElementsAre("1: 6..9 (2)", "2: 5..6 (0)", "3: 0..1 (1)"));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 8, 2, 2)})), ElementsAre("1: 8..9 (2)"));
}

TEST(FinalFilterTest, ProvisionalSamplesOfFinalFramesAreCutToo) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 6, 6)}));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 3, 5, 0)})), ElementsAre("1: 6..7 (0)"));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 3, 2, 0)})), IsEmpty());
}

TEST(FinalFilterTest, ASecondLossCutsWhatCameSinceTheFirst) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 4, 4)}));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 2, 6, 6)})), ElementsAre("1: 4..7 (4)"));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 2, 8, 8)})), ElementsAre("1: 8..9 (2)"));
}

TEST(FinalFilterTest, ANewTrackOfAnIdIsWholeRightBehindItsOldOne) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 6, 6)}));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 4, 2, 2)})), IsEmpty());                   // the old track's end, again
  EXPECT_THAT(Left(filter, Update({Estimates(1, 6, 3, 3)})), ElementsAre("1: 6..8 (3)"));  // the new one's beginning
}

TEST(FinalFilterTest, ANewTrackAtItsOldOnesLastFrameIsCutOnlyWhereBothWereReported) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 6, 6)}));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 5, 3, 3)})), ElementsAre("1: 5..7 (3)"));
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(1, 3, 3, 3), Estimates(1, 5, 5, 5)})), ElementsAre("1: 8..9 (2)"));
  EXPECT_THAT(Left(filter, Update({Estimates(1, 9, 3, 3)})),
              ElementsAre("1: 9..11 (3)"));  // after the loss: as it comes
}

TEST(FinalFilterTest, WatermarksNeverFall) {
  FinalFilter filter;
  Left(filter, Update({}, 20, 16));
  filter.Resume();
  TrackUpdate update = Update({}, 12, 8);
  filter.Apply(update);
  EXPECT_EQ(update.frames_received, 20);
  EXPECT_EQ(update.frames_processed, 16);
  update = Update({}, 24, 17);
  filter.Apply(update);
  EXPECT_EQ(update.frames_received, 24);
  EXPECT_EQ(update.frames_processed, 17);
}

TEST(FinalFilterTest, CaptureTimesGoWithTheFramesTheyBelongTo) {
  FinalFilter filter;
  Left(filter, Update({Estimates(1, 0, 4, 4)}));
  filter.Resume();
  TrackUpdate update = Update({Estimates(1, 2, 4, 4)});
  for (int64_t frame = 2; frame < 6; ++frame) update.capture_times.push_back({frame, absl::UnixEpoch()});
  filter.Apply(update);
  ASSERT_EQ(update.capture_times.size(), 2u);
  EXPECT_EQ(update.capture_times[0].frame, 4);
  update = Update({Estimates(1, 2, 2, 2)});
  update.capture_times.push_back({2, absl::UnixEpoch()});
  filter.Apply(update);
  EXPECT_THAT(update.capture_times, IsEmpty());
}

TEST(FinalFilterTest, WhatCannotComeAgainIsForgotten) {
  FinalFilter filter;
  for (PointId id = 0; id < 10; ++id) Left(filter, Update({Estimates(id, static_cast<int64_t>(id), 4, 4)}));
  EXPECT_EQ(filter.points_remembered(), 10u);
  filter.ForgetBefore(8);
  EXPECT_EQ(filter.points_remembered(), 5u);
  filter.Resume();
  EXPECT_THAT(Left(filter, Update({Estimates(4, 7, 2, 2), Estimates(5, 7, 3, 3)})),
              ElementsAre("4: 7..8 (2)", "5: 9..9 (1)"));
}

TEST(FinalFilterTest, NoFinalSampleOfAnObjectComesTwice) {
  FinalFilter filter;
  const auto update = [](int64_t first, size_t length, int64_t finals) {
    TrackUpdate made;
    made.objects = {{3, first, std::vector<ObjectSample>(length), finals}};
    return made;
  };
  TrackUpdate first = update(0, 12, 9);
  filter.Apply(first);
  EXPECT_EQ(first.objects[0].samples.size(), 12U);
  filter.Resume();
  TrackUpdate again = update(0, 8, 8);
  filter.Apply(again);
  EXPECT_THAT(again.objects, IsEmpty());
  TrackUpdate on = update(6, 8, 5);
  filter.Apply(on);
  ASSERT_EQ(on.objects.size(), 1U);
  EXPECT_EQ(on.objects[0].first_frame, 9);
  EXPECT_EQ(on.objects[0].samples.size(), 5U);
  EXPECT_EQ(on.objects[0].final_count, 2);
}

}  // namespace
}  // namespace holdfast
