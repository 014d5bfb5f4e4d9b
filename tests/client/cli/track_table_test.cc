// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

StartPoint Start(PointId id, int64_t frame) { return {{id, 0, 0}, frame, "p"}; }

PointRun RunOf(PointId id, int64_t first_frame, std::vector<float> x, int64_t final_count) {
  const size_t n = x.size();
  return {id,
          first_frame,
          std::move(x),
          std::vector<float>(n, 2),
          std::vector<uint8_t>(n, 1),
          std::vector<float>(n, 0.5f),
          final_count};
}

TrackUpdate Update(int64_t frames, std::vector<PointRun> runs) { return {std::move(runs), frames, frames}; }

float FinalX(const TrackTable& table, size_t track, int64_t frame) {
  const TrackSample* sample = TrackTable::Estimate(table.tracks()[track], frame);
  return sample == nullptr || !sample->is_final() ? -1 : sample->x;
}

TEST(TrackTableTest, QueriesAreWhereTheyWereGiven) {
  TrackTable table({{{1, 0, 99.5f}, 0, "a"}, {{2, 7, 8}, 2, "b"}}, StartObject{{1, "png"}, 0, 10});
  for (int64_t frame = 0; frame < 3; ++frame) table.AddFrame(frame);
  std::vector<PointRun> runs = {RunOf(1, 0, {2.5f, 3}, 1), RunOf(1, 1, {3, 4}, 1), RunOf(2, 2, {6.5f}, 0),
                                RunOf(10, 0, {5}, 0), RunOf(77, 0, {5}, 0)};
  table.RestoreQueries(runs);
  EXPECT_EQ(runs[0].x, (std::vector<float>{0, 3}));
  EXPECT_EQ(runs[0].y, (std::vector<float>{99.5f, 2}));
  EXPECT_EQ(runs[1].x, (std::vector<float>{3, 4}));
  EXPECT_EQ(runs[2].x[0], 7);
  EXPECT_EQ(runs[3].x[0], 5) << "the tracker has placed it";
  EXPECT_EQ(runs[4].x[0], 5);
}

TEST(TrackTableTest, RevisionsReplaceProvisionalEstimatesAndFinalOnesStay) {
  TrackTable table({Start(1, 0)});
  ASSERT_THAT(table.Apply(Update(3, {RunOf(1, 0, {10, 11, 12}, 1)})), IsOk());
  EXPECT_EQ(FinalX(table, 0, 0), 10);
  EXPECT_EQ(FinalX(table, 0, 1), -1);
  ASSERT_THAT(table.Apply(Update(4, {RunOf(1, 1, {21, 22, 23}, 2)})), IsOk());
  ASSERT_THAT(table.Apply(Update(4, {RunOf(1, 0, {90, 91, 92, 93}, 0)})), IsOk());
  EXPECT_EQ(FinalX(table, 0, 0), 10);
  EXPECT_EQ(FinalX(table, 0, 1), 21);
  EXPECT_EQ(FinalX(table, 0, 2), 22);
  EXPECT_EQ(FinalX(table, 0, 3), -1);
  EXPECT_EQ(table.tracks()[0].samples[3].x, 93);
}

TEST(TrackTableTest, FramesAreFinalWhenEveryPointThatLivesThereIs) {
  TrackTable table({Start(1, 0), Start(2, 2)});
  EXPECT_EQ(table.final_frames(), 0);
  ASSERT_THAT(table.Apply(Update(5, {RunOf(1, 0, {0, 1, 2, 3}, 4)})), IsOk());
  EXPECT_EQ(table.final_frames(), 2);  // the second point starts there
  ASSERT_THAT(table.Apply(Update(5, {RunOf(2, 2, {0, 1, 2}, 1)})), IsOk());
  EXPECT_EQ(table.final_frames(), 3);
  ASSERT_THAT(table.Apply(Update(5, {RunOf(2, 3, {1, 2}, 2), RunOf(1, 4, {4}, 1)})), IsOk());
  EXPECT_EQ(table.final_frames(), 5);
}

TEST(TrackTableTest, EstimatesReachToTheLastOneOfAnyPoint) {
  TrackTable table({Start(1, 0), Start(2, 2)});
  ASSERT_THAT(table.Apply(Update(9, {})), IsOk());
  EXPECT_EQ(table.estimated_frames(), 0) << "frames without an estimate do not count";
  ASSERT_THAT(table.Apply(Update(9, {RunOf(1, 0, {10, 11}, 1), RunOf(2, 5, {15, 16}, 0)})), IsOk());
  EXPECT_EQ(table.estimated_frames(), 7);
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[0], 1)->x, 11) << "provisional ones count";
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[0], 2), nullptr);
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[1], 1), nullptr) << "before its start";
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[1], 4), nullptr) << "a gap before its first estimate";
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[1], 6)->x, 16);
}

TEST(TrackTableTest, APointThatNeverStartsDoesNotHoldTheOthersBack) {
  TrackTable table({Start(1, 0), Start(2, 100)});
  ASSERT_THAT(table.Apply(Update(2, {RunOf(1, 0, {0, 1}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 2);
  EXPECT_TRUE(table.tracks()[1].samples.empty());
}

TEST(TrackTableTest, KnowsHowFarThereAreEstimatesFinalOrNot) {
  TrackTable table({Start(1, 0), Start(2, 1)});
  ASSERT_THAT(table.Apply(Update(4, {RunOf(1, 0, {0, 1, 2, 3}, 1), RunOf(2, 1, {5}, 0)})), IsOk());
  EXPECT_EQ(table.answered_frames(), 2);
  EXPECT_EQ(table.final_frames(), 1);
  ASSERT_THAT(table.Apply(Update(4, {RunOf(2, 3, {7}, 0)})), IsOk());
  EXPECT_EQ(table.answered_frames(), 2) << "frame 2 of the second point is missing";
  ASSERT_THAT(table.Apply(Update(4, {RunOf(2, 2, {6}, 0)})), IsOk());
  EXPECT_EQ(table.answered_frames(), 4);
}

TEST(TrackTableTest, AnUpdateWithoutRunsMovesTheWatermark) {
  TrackTable table({Start(1, 9)});
  ASSERT_THAT(table.Apply(Update(4, {})), IsOk());
  EXPECT_EQ(table.frames(), 4);
  EXPECT_EQ(table.final_frames(), 4);
}

TEST(TrackTableTest, AnswersThatContradictTheSessionAreErrors) {
  TrackTable table({Start(1, 2)});
  const auto code = absl::StatusCode::kInternal;
  EXPECT_THAT(table.Apply(Update(5, {RunOf(9, 2, {1}, 1)})), StatusIs(code));                 // unknown point
  EXPECT_THAT(table.Apply(Update(5, {RunOf(1, 1, {1}, 1)})), StatusIs(code));                 // before its start
  EXPECT_THAT(table.Apply(Update(5, {RunOf(1, 4, {1, 2}, 1)})), StatusIs(code));              // after the last frame
  EXPECT_THAT(table.Apply(Update(5, {RunOf(1, int64_t{1} << 62, {1}, 1)})), StatusIs(code));  // far after it
  EXPECT_TRUE(table.tracks()[0].samples.empty());
}

TEST(TrackTableTest, APointStartsWhereItsFrameComesHoweverManyWereLeftOut) {
  TrackTable table({Start(1, 10), Start(2, 25)});
  table.AddFrame(10);
  table.AddFrame(20, absl::FromUnixSeconds(7));
  ASSERT_THAT(table.Apply(Update(2, {RunOf(1, 0, {0, 1}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 2) << "the second point has not come";
  EXPECT_THAT(table.Apply(Update(3, {RunOf(2, 2, {5}, 1)})), StatusIs(absl::StatusCode::kInternal));
  table.AddFrame(25);
  ASSERT_THAT(table.Apply(Update(3, {RunOf(2, 2, {5}, 1)})), IsOk());
  EXPECT_EQ(FinalX(table, 1, 2), 5);
  EXPECT_EQ(table.Number(1), 20);
  EXPECT_EQ(table.CaptureTime(1), absl::FromUnixSeconds(7));
  EXPECT_EQ(table.CaptureTime(2), std::nullopt);
}

TEST(TrackTableTest, WhatLiesBeforeAQueryIsTakenFromTheWayBackAlone) {
  TrackTable table({Start(1, 2)}, std::nullopt, TrackTable::Direction::kBoth);
  for (int64_t number = 0; number < 4; ++number) table.AddFrame(number);
  EXPECT_THAT(table.Apply(Update(4, {RunOf(1, 1, {1}, 1)})), StatusIs(absl::StatusCode::kInternal));
  ASSERT_THAT(table.Apply(Update(4, {RunOf(1, 2, {2, 3}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 0) << "frames 0 and 1 are to come";
  EXPECT_EQ(TrackTable::Estimate(table.tracks()[0], 1), nullptr);
  EXPECT_THAT(table.ApplyBackward(Update(0, {RunOf(1, 2, {9}, 1)})), StatusIs(absl::StatusCode::kInternal));
  ASSERT_THAT(table.ApplyBackward(Update(0, {RunOf(1, 0, {0, 1}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 4);
  EXPECT_EQ(FinalX(table, 0, 1), 1);
  EXPECT_EQ(FinalX(table, 0, 2), 2);
}

StartObject TheObject() {
  StartObject object;
  object.query.id = 1;
  object.frame = 2;
  object.first_point = 10;
  return object;
}
ObjectRun ObjectRunOf(int64_t first_frame, const std::vector<float>& x, int64_t final_count) {
  ObjectRun run{1, first_frame, {}, final_count};
  for (const float value : x) run.samples.push_back({{value, 0}, 1, 0, 1, {}, {}, {}});
  return run;
}

TEST(TrackTableTest, PointsOfAnObjectJoinWhenTheyAreHeardOf) {
  TrackTable table({Start(1, 0)}, TheObject());
  ASSERT_THAT(table.Apply(Update(2, {RunOf(1, 0, {0, 1}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 2);
  ASSERT_THAT(table.Apply(Update(4, {RunOf(1, 2, {2, 3}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 2) << "the object lives from here on";
  TrackUpdate update = Update(4, {RunOf(11, 2, {5, 6}, 1)});
  update.objects = {ObjectRunOf(2, {7, 8}, 1)};
  ASSERT_THAT(table.Apply(update), IsOk());
  ASSERT_EQ(table.tracks().size(), 2u);
  EXPECT_EQ(table.tracks()[1].start.query.id, 11u);
  EXPECT_EQ(table.tracks()[1].start.query.x, 5);
  EXPECT_EQ(table.final_frames(), 3);
  EXPECT_EQ(table.ObjectEstimate(1), nullptr);
  EXPECT_EQ(table.ObjectEstimate(3)->centre.x, 8);
  update = Update(5, {});
  update.objects = {ObjectRunOf(2, {90, 80, 70}, 0)};
  ASSERT_THAT(table.Apply(update), IsOk());
  EXPECT_EQ(table.ObjectEstimate(2)->centre.x, 7) << "final";
  EXPECT_EQ(table.ObjectEstimate(3)->centre.x, 80);
}

TEST(TrackTableTest, AnObjectStartsWhereItsFrameComesAndItsPointsHaveAPastWithBoth) {
  StartObject object = TheObject();
  object.frame = 25;
  TrackTable table({}, object, TrackTable::Direction::kBoth);
  for (const int64_t number : {10, 20, 25}) table.AddFrame(number);
  TrackUpdate update = Update(3, {RunOf(10, 2, {5}, 1)});
  update.objects = {ObjectRunOf(2, {7}, 1)};
  ASSERT_THAT(table.Apply(update), IsOk());
  EXPECT_EQ(table.ObjectEstimate(2)->centre.x, 7);
  EXPECT_EQ(table.tracks()[0].start.frame, 25);
  EXPECT_EQ(table.tracks()[0].query_frame, 2);
  EXPECT_EQ(table.final_frames(), 0) << "frames 0 and 1 are to come";
  ASSERT_THAT(table.ApplyBackward(Update(0, {RunOf(10, 0, {3, 4}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 3);
  EXPECT_EQ(table.tracks()[0].start.query.x, 5) << "where it was placed";
}

TEST(TrackTableTest, APointThatWasPlacedAnewTakesAPlaceFromWhichNothingMoreIsExpected) {
  TrackTable table({}, TheObject(), TrackTable::Direction::kBoth);
  for (int64_t number = 0; number < 9; ++number) table.AddFrame(number);
  TrackUpdate update = Update(7, {RunOf(10, 2, {1, 1, 1, 1, 1}, 3), RunOf(11, 2, {2, 2, 2, 2, 2}, 3)});
  update.objects = {ObjectRunOf(2, {7, 7, 7, 7, 7}, 3)};
  ASSERT_THAT(table.Apply(update), IsOk());
  ASSERT_THAT(table.ApplyBackward(Update(0, {RunOf(10, 0, {1, 1}, 2), RunOf(11, 0, {2, 2}, 2)})), IsOk());
  EXPECT_EQ(table.final_frames(), 5);
  update = Update(7, {RunOf(10 + 256, 4, {5, 5, 5}, 1)});
  update.objects = {ObjectRunOf(5, {8, 8}, 0)};
  update.objects[0].samples[0].joined = {10 + 256};
  ASSERT_THAT(table.Apply(update), IsOk());
  ASSERT_EQ(table.tracks().size(), 3u);
  const TableTrack &before = table.tracks()[0], &anew = table.tracks()[2];
  EXPECT_FALSE(table.WasPlacedAnew(before));
  EXPECT_TRUE(table.WasPlacedAnew(anew));
  EXPECT_EQ(anew.start.frame, 4);
  EXPECT_EQ(anew.start.query.x, 5);
  EXPECT_EQ(anew.first_frame, 4) << "what lay before it is its predecessor's";
  EXPECT_EQ(TrackTable::Estimate(before, 4)->x, 1);
  EXPECT_EQ(TrackTable::Estimate(before, 5), nullptr) << "void";
  update = Update(9, {RunOf(10, 5, {3, 4}, 2), RunOf(11, 5, {2, 2, 2, 2}, 4), RunOf(10 + 256, 5, {5, 5, 5, 5}, 4)});
  update.objects = {ObjectRunOf(5, {8, 8, 8, 8}, 4)};
  ASSERT_THAT(table.Apply(update), IsOk());
  EXPECT_EQ(TrackTable::Estimate(before, 6)->x, 4) << "its last final ones";
  EXPECT_EQ(TrackTable::Estimate(before, 7), nullptr);
  EXPECT_EQ(table.final_frames(), 9);
  EXPECT_EQ(table.answered_frames(), 9);
}

TEST(TrackTableTest, ObjectsAndPointsOfObjectsThatWereNotAskedForAreRefused) {
  TrackTable table({Start(1, 0)}, TheObject());
  ASSERT_THAT(table.Apply(Update(5, {})), IsOk());
  for (const PointRun& run :
       {RunOf(9, 2, {5}, 1), RunOf(11, 3, {5}, 1), RunOf(10 + 256, 2, {5}, 1), RunOf(10 + 256, 3, {5}, 1)}) {
    EXPECT_THAT(table.Apply(Update(5, {run})), StatusIs(absl::StatusCode::kInternal)) << run.id;
  }
  TrackUpdate update = Update(5, {});
  for (const ObjectRun& run : {ObjectRunOf(1, {5}, 1), ObjectRunOf(4, {5, 6}, 1), ObjectRun{2, 2, {{}}, 0}}) {
    update.objects = {run};
    EXPECT_THAT(table.Apply(update), StatusIs(absl::StatusCode::kInternal)) << run.first_frame;
  }
}

}  // namespace
}  // namespace holdfast
