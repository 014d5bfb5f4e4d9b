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
  TrackTable table({Start(1, 2)}, TrackTable::Direction::kBoth);
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

}  // namespace
}  // namespace holdfast
