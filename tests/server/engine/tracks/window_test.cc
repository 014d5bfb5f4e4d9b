// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/window.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int64_t kFrames = 24;

WindowOptions Hop(int64_t hop, bool early = false) { return {kFrames, hop, early}; }

// Every window of a point queried at 'query' in a stream of 'frames' frames that arrive one by one.
std::vector<WindowPlan> AllWindows(WindowSchedule schedule, int64_t query, int64_t frames) {
  std::vector<WindowPlan> plans;
  for (int64_t newest = query; newest < frames; ++newest) {
    const bool ended = newest == frames - 1;
    while (const auto plan = schedule.Next(newest, /*ended=*/false)) {
      plans.push_back(*plan);
      schedule.Ran(*plan);
    }
    if (!ended) continue;
    if (const auto plan = schedule.Next(newest, true)) {
      plans.push_back(*plan);
      schedule.Ran(*plan);
    }
    EXPECT_EQ(schedule.Next(newest, true), std::nullopt);
  }
  return plans;
}

WindowPlan Full(int64_t first, int64_t final_before, bool from_query = false) {
  return {WindowKind::kFull, first, first + kFrames - 1, from_query, final_before};
}

TEST(WindowScheduleTest, WaitsForTheLastFrameOfTheWindow) {
  WindowSchedule schedule(Hop(8), 100);
  EXPECT_EQ(schedule.Next(122, false), std::nullopt);
  EXPECT_EQ(schedule.Next(123, false), Full(100, 109, /*from_query=*/true));
}

TEST(WindowScheduleTest, AWindowThatMakesItsNewestFrameFinalWaitsForTheNextOrTheEnd) {
  WindowSchedule schedule(Hop(23), 100);
  EXPECT_EQ(schedule.Next(123, false), std::nullopt);
  EXPECT_EQ(schedule.Next(123, true), Full(100, 124, /*from_query=*/true));
  EXPECT_EQ(schedule.Next(124, false), Full(100, 124, /*from_query=*/true));
}

TEST(WindowScheduleTest, LaterWindowsFollowAtTheHopAndStartFromEstimates) {
  WindowSchedule schedule(Hop(8), 0);
  schedule.Ran(*schedule.Next(23, false));
  EXPECT_EQ(schedule.Next(30, false), std::nullopt);
  EXPECT_EQ(schedule.Next(31, false), Full(8, 17));
}

TEST(WindowScheduleTest, RunsEachFullWindowInOrderWhenFramesAreFarAhead) {
  WindowSchedule schedule(Hop(8), 0);
  std::vector<int64_t> firsts;
  while (const auto plan = schedule.Next(40, false)) {
    firsts.push_back(plan->first);
    schedule.Ran(*plan);
  }
  EXPECT_THAT(firsts, ElementsAre(0, 8, 16));
}

TEST(WindowScheduleTest, RunsTheFirstWindowEarlyEveryHopFramesWithoutMakingAnythingFinal) {
  const auto plans = AllWindows(WindowSchedule(Hop(8, true), 5), 5, 29);
  EXPECT_THAT(plans, ElementsAre(WindowPlan{WindowKind::kEarly, 5, 12, true, 6},
                                 WindowPlan{WindowKind::kEarly, 5, 20, true, 6}, Full(5, 14, true)));
}

TEST(WindowScheduleTest, RunsOnlyTheNewestEarlyWindowWhenSeveralAreDue) {
  WindowSchedule schedule(Hop(4, true), 0);
  const auto plan = schedule.Next(13, false);
  ASSERT_TRUE(plan.has_value());
  EXPECT_EQ(plan->last, 11);
  schedule.Ran(*plan);
  EXPECT_EQ(schedule.Next(14, false), std::nullopt);
}

TEST(WindowScheduleTest, WantsTwoFramesForAnEarlyWindow) {
  WindowSchedule schedule(Hop(1, true), 0);
  EXPECT_EQ(schedule.Next(0, false), std::nullopt);
  EXPECT_EQ(schedule.Next(1, false), (WindowPlan{WindowKind::kEarly, 0, 1, true, 1}));
}

TEST(WindowScheduleTest, ShiftsTheLastWindowBackToEndOnTheLastFrame) {
  EXPECT_THAT(AllWindows(WindowSchedule(Hop(8), 0), 0, 30),
              ElementsAre(Full(0, 9, true), WindowPlan{WindowKind::kLast, 6, 29, false, 30}));
}

TEST(WindowScheduleTest, RunsNoLastWindowWhenOneHasJustEndedThere) {
  EXPECT_THAT(AllWindows(WindowSchedule(Hop(8), 0), 0, 24), ElementsAre(Full(0, 9, true)));
  EXPECT_THAT(
      AllWindows(WindowSchedule(Hop(4, true), 0), 0, 8),
      ElementsAre(WindowPlan{WindowKind::kEarly, 0, 3, true, 1}, WindowPlan{WindowKind::kEarly, 0, 7, true, 1}));
}

TEST(WindowScheduleTest, FillsTheOnlyWindowOfAShortClipByRepetition) {
  EXPECT_THAT(AllWindows(WindowSchedule(Hop(8), 2), 2, 12),
              ElementsAre(WindowPlan{WindowKind::kLast, 2, 11, true, 12}));
}

TEST(WindowScheduleTest, HasNothingToDoForAPointOnTheLastFrame) {
  EXPECT_THAT(AllWindows(WindowSchedule(Hop(1, true), 9), 9, 10), IsEmpty());
}

TEST(WindowScheduleTest, KeepsMoreProvisionalWhereTheLastWindowMayReviseIt) {
  WindowOptions options = Hop(23);
  options.revise_last = true;
  EXPECT_THAT(AllWindows(WindowSchedule(options, 0), 0, 30),
              ElementsAre(Full(0, 2, true), WindowPlan{WindowKind::kLast, 6, 29, false, 30}));
}

class EveryHop : public ::testing::TestWithParam<int> {};

// Whatever the length: windows follow each other, start where estimates are, and end with everything final.
TEST_P(EveryHop, MakesEveryFrameFinalExactlyOnceAndInOrder) {
  for (const bool early : {false, true}) {
    for (int64_t frames = 1; frames < 80; ++frames) {
      const int64_t query = frames / 3;
      int64_t final_before = query + 1, estimated = query;
      for (const WindowPlan& plan : AllWindows(WindowSchedule(Hop(GetParam(), early), query), query, frames)) {
        EXPECT_GE(plan.first, query);
        EXPECT_LE(plan.last - plan.first, kFrames - 1);
        EXPECT_LE(plan.first, estimated);                           // starts from an estimate that is there
        EXPECT_TRUE(plan.from_query || plan.first < final_before);  // and that is final, for it is kept
        EXPECT_EQ(plan.from_query, plan.first == query);
        EXPECT_GE(plan.final_before, final_before);
        EXPECT_GE(plan.last, estimated);
        EXPECT_LE(plan.final_before, plan.last + 1);
        final_before = plan.final_before;
        estimated = plan.last;
      }
      EXPECT_EQ(estimated, frames - 1);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Hops, EveryHop, ::testing::Range(1, 24));

}  // namespace
}  // namespace holdfast
