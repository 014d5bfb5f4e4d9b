// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/point_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kPoints = 4;
constexpr int64_t kMostAtOneFrame = 4 * kPoints + 1024;

// As the inbox does it: checked, then changed.
absl::Status Seed(PointQueue& queue, const std::vector<PointQuery>& points) {
  if (absl::Status status = queue.CheckSeeds("list", points, queue.frame()); !status.ok()) return status;
  queue.Seed("list", points);
  return absl::OkStatus();
}
absl::Status Remove(PointQueue& queue, const std::vector<PointId>& ids) {
  if (absl::Status status = queue.CheckRemovals("ids", ids); !status.ok()) return status;
  queue.Remove(ids);
  return absl::OkStatus();
}

// "+7@0(3)": point 7 is seeded at x = 3 of frame 0; "-7@0": removed.
std::vector<std::string> Take(PointQueue& queue, int64_t newest_frame) {
  std::vector<std::string> texts;
  for (const PointOp& op : queue.Take(newest_frame)) {
    const bool seed = op.kind == PointOp::Kind::kSeed;
    texts.push_back(
        absl::StrCat(seed ? "+" : "-", op.query.id, "@", op.frame, seed ? absl::StrCat("(", op.query.x, ")") : ""));
  }
  return texts;
}
std::vector<PointQuery> All(float x) { return {{1, x}, {2, x}, {3, x}, {4, x}}; }

TEST(PointQueueTest, ALaterSeedOfTheSameFrameReplacesAnEarlierOne) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}, {2, 20}}), IsOk());
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  const std::vector<PointOp> ops = queue.Take(0);
  ASSERT_EQ(ops.size(), 2U);
  EXPECT_EQ(ops[0].query.id, 2U);
  EXPECT_EQ(ops[0].seeds, 1);
  EXPECT_EQ(ops[1].query.x, 11);
  EXPECT_EQ(ops[1].seeds, 2) << "the one that was replaced counts as a point, too";
}

TEST(PointQueueTest, SeedsOfDifferentFramesAreBothThere) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  queue.StartFrame(0);
  queue.StartFrame(1);
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  EXPECT_THAT(Take(queue, 1), ElementsAre("+1@0(10)", "+1@1(11)"));
}

TEST(PointQueueTest, WhatWasTakenIsNotReplaced) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  EXPECT_THAT(Take(queue, 0), ElementsAre("+1@0(10)"));
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  ASSERT_THAT(Remove(queue, {1}), IsOk());
  EXPECT_THAT(Take(queue, 0), ElementsAre("+1@0(11)", "-1@0"));
}

TEST(PointQueueTest, ARemovedSeedIsStillReportedUnlessAnotherFollows) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  ASSERT_THAT(Remove(queue, {1, 1, 99}), IsOk());
  EXPECT_THAT(Take(queue, 0), ElementsAre("+1@0(10)", "-1@0"));
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  ASSERT_THAT(Remove(queue, {1}), IsOk());
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  EXPECT_THAT(Take(queue, 0), ElementsAre("+1@0(11)"));
}

TEST(PointQueueTest, TheRemovalOfAPointFromAnEarlierFrameStays) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  queue.StartFrame(1);
  ASSERT_THAT(Remove(queue, {1}), IsOk());
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  ASSERT_THAT(Seed(queue, {{1, 12}}), IsOk());
  EXPECT_THAT(Take(queue, 1), ElementsAre("+1@0(10)", "-1@1", "+1@1(12)"));
}

TEST(PointQueueTest, ReSeedingAndRemovingWithoutEndKeepsItShort) {
  PointQueue queue(kPoints);
  for (int i = 0; i < 10'000; ++i) {
    ASSERT_THAT(Seed(queue, All(static_cast<float>(i))), IsOk());
    if (i % 2 == 0) {
      ASSERT_THAT(Remove(queue, {1, 2, 3, 4}), IsOk());
    }
    ASSERT_LE(queue.size(), 2 * kPoints);
  }
  EXPECT_THAT(Take(queue, 0), ElementsAre("+1@0(9999)", "+2@0(9999)", "+3@0(9999)", "+4@0(9999)"));
}

TEST(PointQueueTest, NewIdsWithoutEndAreRefusedAtOneFrame) {
  PointQueue queue(kPoints);
  absl::Status status;
  PointId id = 0;
  for (; status.ok() && id < 10'000; ++id) {
    status = Seed(queue, {{id, 1}});
    if (status.ok()) status = Remove(queue, {id});
  }
  EXPECT_THAT(status, StatusIs(kExhausted, HasSubstr("at most 1040 changes of points may wait at one frame")));
  EXPECT_EQ(queue.size(), kMostAtOneFrame);
  queue.StartFrame(1);
  EXPECT_THAT(Seed(queue, {{id, 1}}), IsOk()) << "the next frame has room of its own";
  queue.Take(0);
  EXPECT_EQ(queue.size(), 1);
}

TEST(PointQueueTest, WhatWasTakenMakesRoom) {
  PointQueue queue(kPoints);
  for (PointId id = 0; id < 10'000; ++id) {
    ASSERT_THAT(Seed(queue, {{id, 1}}), IsOk());
    ASSERT_THAT(Remove(queue, {id}), IsOk());
    if (id % 100 == 0) queue.Take(0);
  }
}

TEST(PointQueueTest, WhatWasTakenAndNotAppliedStillWaits) {
  PointQueue queue(kPoints);
  for (int i = 0; i < kMostAtOneFrame; ++i) {
    ASSERT_THAT(Seed(queue, {{1, 1}}), IsOk());
    ASSERT_EQ(queue.Take(0, /*applied=*/false).size(), 1U);
  }
  EXPECT_THAT(Seed(queue, {{1, 1}}), StatusIs(kExhausted));
  EXPECT_THAT(queue.Take(0), IsEmpty());
  EXPECT_THAT(Seed(queue, {{1, 1}}), IsOk());
}

TEST(PointQueueTest, EveryPointCanBeReplacedAtOneFrame) {
  constexpr int kMany = 5000;
  PointQueue queue(kMany);
  for (PointId base : {0, 1}) {
    std::vector<PointQuery> points;
    std::vector<PointId> ids;
    for (PointId id = base * kMany; id < (base + 1) * kMany; ++id) {
      points.push_back({id, 1});
      ids.push_back(id);
    }
    ASSERT_THAT(Seed(queue, points), IsOk());
    ASSERT_THAT(Remove(queue, ids), IsOk());
  }
}

TEST(PointQueueTest, CountsPointsOfAllMessages) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1}, {2}, {3}}), IsOk());
  EXPECT_THAT(Seed(queue, {{3}, {4}, {5}}), StatusIs(kExhausted, HasSubstr("points of a session: at most 4")));
  EXPECT_EQ(queue.size(), 3) << "nothing has changed";
  EXPECT_THAT(Seed(queue, {{3}, {4}}), IsOk());
}

TEST(PointQueueTest, DropsWhatBelongsToFramesThatWillNotCome) {
  PointQueue queue(kPoints);
  ASSERT_THAT(Seed(queue, {{1, 10}}), IsOk());
  queue.StartFrame(1);
  ASSERT_THAT(Seed(queue, {{1, 11}}), IsOk());
  queue.DropFrom(1);
  EXPECT_THAT(Take(queue, 9), ElementsAre("+1@0(10)"));
  EXPECT_TRUE(queue.empty());
  EXPECT_THAT(Take(queue, 9), IsEmpty());
}

ObjectQuery Three(ObjectId id) { return {id, "png", {}, 3}; }
std::vector<PointQuery> Placed(ObjectId id, int count) {
  std::vector<PointQuery> points;
  for (int i = 0; i < count; ++i) points.push_back({ObjectPointId(id, static_cast<uint32_t>(i)), 10.0f + i, 0});
  return points;
}

TEST(PointQueueTest, PointsOfAnObjectAreSeededWhereItIsPlaced) {
  PointQueue queue(kPoints);
  queue.Seed("list", {{1, 5}});
  ASSERT_THAT(queue.CheckObjects("objects", {Three(2)}, {}, 0), IsOk());
  queue.SeedObject(Three(2));
  queue.PlaceObject(2, 0, Placed(2, 2));
  const std::vector<PointOp> ops = queue.Take(0);
  ASSERT_EQ(ops.size(), 3U);
  EXPECT_EQ(ops[1].query.id, ObjectPointId(2, 0));
  EXPECT_EQ(ops[1].query.x, 10);
  EXPECT_EQ(ops[2].query.x, 11);
  EXPECT_NE(ops[1].serial, ops[2].serial);
  EXPECT_EQ(queue.size(), 0);
  EXPECT_THAT(Seed(queue, {{5, 1}}), IsOk()) << "three points are tracked, not four";
}

TEST(PointQueueTest, AnObjectIdIsFreeWhenItsPointsAre) {
  PointQueue queue(kPoints);
  queue.SeedObject(Three(2));
  queue.PlaceObject(2, 0, Placed(2, 3));
  const auto status = queue.CheckObjects("objects", {Three(2)}, {}, 1);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted));
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 0), ObjectPointId(2, 1)}), IsOk());
  EXPECT_THAT(queue.CheckObjects("objects", {Three(2)}, {}, 1), StatusIs(absl::StatusCode::kInvalidArgument));
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 2)}), IsOk());
  queue.StartFrame(1);
  ASSERT_THAT(queue.CheckObjects("objects", {Three(2)}, {}, 1), IsOk());
  queue.SeedObject(Three(2));
  queue.PlaceObject(2, 1, Placed(2, 3));
  EXPECT_EQ(queue.Take(1).size(), 9U) << "frame 0: 3 seeds and 3 removals; frame 1: 3 seeds";
}

TEST(PointQueueTest, AnObjectThatIsPlacedAfterItsIdWasFreedTakesNothingFromTheNext) {
  PointQueue queue(kPoints);
  queue.SeedObject(Three(2));
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 0), ObjectPointId(2, 1), ObjectPointId(2, 2)}), IsOk());
  queue.StartFrame(1);
  queue.SeedObject(Three(2));
  queue.PlaceObject(2, 0, Placed(2, 2));
  queue.PlaceObject(2, 1, Placed(2, 3));
  (void)queue.Take(0);
  ASSERT_EQ(queue.Take(1).size(), 3U);
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 2)}), IsOk());
  EXPECT_EQ(queue.size(), 1) << "the second object's third point is removed";
}

// A point of such an id beside an object that is still to be placed would be placed, or dropped, for one of its own.
TEST(PointQueueTest, TheIdsOfAnObjectThatWasRemovedAreFreeFromTheNextFrameOn) {
  const PointId id = ObjectPointId(2, 2);
  PointQueue queue(kPoints);
  queue.SeedObject(Three(2));
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 0), ObjectPointId(2, 1), id}), IsOk());
  EXPECT_THAT(Seed(queue, {{id, 1}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("list[0].id")));
  EXPECT_THAT(queue.CheckObjects("objects", {Three(2)}, {}, 0),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("2 is in use")));
  EXPECT_THAT(queue.CheckObjects("objects", {Three(2)}, {}, 1), IsOk());
  queue.StartFrame(1);
  ASSERT_THAT(Seed(queue, {{id, 1}}), IsOk());
  queue.PlaceObject(2, 0, Placed(2, 2));
  ASSERT_THAT(Seed(queue, {{id, 3}}), IsOk());
  (void)queue.Take(0);
  EXPECT_THAT(Take(queue, 1), ElementsAre(absl::StrCat("+", id, "@1(3)")));
}

TEST(PointQueueTest, APointThatWasPlacedAnewIsCountedAndRemovedByItsPlace) {
  PointQueue queue(kPoints);
  queue.SeedObject(Three(2));
  queue.PlaceObject(2, 0, Placed(2, 3));
  EXPECT_EQ(queue.TakeSerials(2), 3u);
  EXPECT_EQ(queue.next_serial(), 5u);
  ASSERT_THAT(Remove(queue, {ObjectSuccessor(ObjectPointId(2, 1))}), IsOk());
  ASSERT_THAT(Remove(queue, {ObjectPointId(2, 1)}), IsOk());
  const std::vector<PointOp> ops = queue.Take(0);
  ASSERT_EQ(ops.size(), 4U) << "the place is removed once";
  EXPECT_EQ(ops[3].query.id, ObjectPointId(2, 1));
  PointQueue free(kPoints);
  const PointId stranger = ObjectPointId(9, 300);
  EXPECT_THAT(Seed(free, {{stranger, 1}}), IsOk());
  ASSERT_THAT(Remove(free, {stranger}), IsOk());
  EXPECT_EQ(free.Take(0)[1].query.id, stranger) << "without objects ids have no places";
}

TEST(PointQueueTest, ObjectsAndPointsCountTogether) {
  PointQueue queue(kPoints);
  EXPECT_THAT(queue.CheckObjects("objects", {Three(2)}, {{1, 1}}, 0), IsOk());
  EXPECT_THAT(queue.CheckObjects("objects", {Three(2)}, {{1, 1}, {2, 1}}, 0),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("at most 4")));
}

TEST(PointQueueTest, IdsOfObjectsPointsAreTheirsAloneOnceThereAreObjects) {
  PointQueue free(kPoints), taken(kPoints), resumed(kPoints);
  const PointId id = ObjectPointId(9, 0);
  EXPECT_THAT(Seed(free, {{id, 1}}), IsOk()) << "without objects any id will do";
  EXPECT_THAT(free.CheckObjects("objects", {Three(2)}, {}, 0), StatusIs(absl::StatusCode::kInvalidArgument));
  ASSERT_THAT(Remove(free, {id}), IsOk());
  EXPECT_THAT(free.CheckObjects("objects", {Three(2)}, {}, 0), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(free.CheckObjects("objects", {Three(2)}, {}, 1), IsOk()) << "what waits at frame 0 is no object's";
  EXPECT_THAT(free.CheckObjects("objects", {Three(2)}, {{id, 1}}, 1), StatusIs(absl::StatusCode::kInvalidArgument));
  taken.SeedObject(Three(2));
  EXPECT_THAT(Seed(taken, {{id, 1}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("list[0].id")));
  resumed.Resume({ObjectPointId(2, 1), 4}, /*objects=*/true, 10);
  EXPECT_THAT(Seed(resumed, {{id, 1}}), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(resumed.CheckObjects("objects", {{2, "png", {}, 1}}, {}, 0),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("2 is in use")));
}

}  // namespace
}  // namespace holdfast
