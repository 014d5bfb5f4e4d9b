// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/session_inbox.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/support/violated_fields.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

SessionInbox::Options Raw() {
  return {{FrameEncoding::kGray8, {4, 2}, 1000}, {/*max_points=*/5, /*max_frame_bytes=*/1000, 1000, 0}, 3};
}
SessionInbox::Options Png() {
  SessionInbox::Options options = Raw();
  options.format = {FrameEncoding::kPng, {}, 1000};
  return options;
}
Frame RawFrame(int64_t index) { return {index, std::string(8, 'x')}; }
Frame PngFrame(int64_t index, int width, int height) {
  std::vector<uint8_t> bytes;
  cv::imencode(".png", cv::Mat(height, width, CV_8UC1, cv::Scalar(1)), bytes);
  return {index, std::string(bytes.begin(), bytes.end())};
}
RgbImage Image() { return {{1, 1}, {0, 0, 0}}; }
void Decode(SessionInbox& inbox, int64_t index) {
  ASSERT_TRUE(inbox.TakeBytes(index).has_value());
  inbox.SetDecoded(index, Image(), SteadyTime());
}
absl::StatusOr<Room> Push(SessionInbox& inbox, Frame frame) { return inbox.Push(std::move(frame), SteadyTime()); }

TEST(SessionInboxTest, SaysWhenItIsFullAndWhenThereIsRoomAgain) {
  SessionInbox inbox(Raw());
  EXPECT_THAT(Push(inbox, RawFrame(0)), IsOkAndHolds(Room::kAvailable));
  EXPECT_THAT(Push(inbox, RawFrame(1)), IsOkAndHolds(Room::kAvailable));
  EXPECT_THAT(Push(inbox, RawFrame(2)), IsOkAndHolds(Room::kFull));
  EXPECT_THAT(Push(inbox, RawFrame(3)), StatusIs(absl::StatusCode::kFailedPrecondition));
  Decode(inbox, 0);
  EXPECT_TRUE(inbox.TakeFrames(1).room);
  EXPECT_THAT(Push(inbox, RawFrame(3)), IsOkAndHolds(Room::kFull));
}

TEST(SessionInboxTest, GivesFramesInOrderThoughTheyAreDecodedInAnyOrder) {
  SessionInbox inbox(Raw());
  for (int64_t i = 0; i < 3; ++i) ASSERT_THAT(Push(inbox, RawFrame(i)), IsOk());
  Decode(inbox, 1);
  EXPECT_EQ(inbox.ready(), 0);
  Decode(inbox, 0);
  EXPECT_EQ(inbox.ready(), 2);
  EXPECT_THAT(inbox.TakeFrames(2).frames, ElementsAre(Field(&DecodedFrame::index, 0), Field(&DecodedFrame::index, 1)));
}

TEST(SessionInboxTest, WantsIndicesWithoutGapOrRepetition) {
  SessionInbox inbox(Raw());
  EXPECT_THAT(ViolatedFields(Push(inbox, RawFrame(1)).status()), ElementsAre("frame.index"));
  ASSERT_THAT(Push(inbox, RawFrame(0)), IsOk());
  EXPECT_THAT(Push(inbox, RawFrame(0)), StatusIs(kInvalid, HasSubstr("frame 0 came instead of frame 1")));
  EXPECT_THAT(Push(inbox, RawFrame(2)), StatusIs(kInvalid, HasSubstr("frame 2 came instead of frame 1")));
  EXPECT_THAT(Push(inbox, RawFrame(int64_t{1} << 62)), StatusIs(kInvalid, HasSubstr("instead of frame 1")));
}

TEST(SessionInboxTest, NamesTheFrameThatIsTooLargeOrOfAnotherSize) {
  SessionInbox inbox(Png());
  ASSERT_THAT(Push(inbox, PngFrame(0, 8, 8)), IsOk());
  EXPECT_THAT(Push(inbox, PngFrame(1, 8, 9)),
              StatusIs(kInvalid, HasSubstr("frame 1: its size is 8x9, the first was 8x8")));
  EXPECT_THAT(Push(inbox, PngFrame(1, 101, 10)), StatusIs(kInvalid, HasSubstr("frame 1: 101x10 is more than 1000")));
  EXPECT_THAT(Push(inbox, {1, std::string(1001, 'x')}), StatusIs(kInvalid, HasSubstr("1001 bytes")));
  EXPECT_THAT(Push(inbox, {1, "no picture"}), StatusIs(kInvalid, HasSubstr("frame 1: no PNG header")));
  EXPECT_THAT(Push(inbox, PngFrame(1, 8, 8)), IsOk()) << "nothing had changed";
}

TEST(SessionInboxTest, NamesThePointsThatAreOutsideAsSoonAsTheSizeIsKnown) {
  SessionInbox inbox(Png());
  EXPECT_THAT(ViolatedFields(inbox.AddPoints("config.points", {{1, -1, 0}, {2, 0, NAN}, {2, 0, 0}})),
              ElementsAre("config.points[0].x", "config.points[1].y", "config.points[2].id"));
  ASSERT_THAT(inbox.AddPoints("config.points", {{1, 7, 7}, {2, 7, 8}}), IsOk());
  Frame frame = PngFrame(0, 8, 8);
  frame.points = {{3, 7.5f, 0}};
  EXPECT_THAT(ViolatedFields(Push(inbox, frame).status()), ElementsAre("frame.points[0].x", "config.points[1].y"));
}

TEST(SessionInboxTest, KnowsTheBoundsOfRawFramesAtOnce) {
  SessionInbox inbox(Raw());
  EXPECT_THAT(inbox.AddPoints("add_points.points", {{1, 3, 1}}), IsOk());
  EXPECT_THAT(ViolatedFields(inbox.AddPoints("add_points.points", {{1, 0, 0}, {2, 3.01f, 0}})),
              ElementsAre("add_points.points[1].x"));
}

TEST(SessionInboxTest, CountsPointsBeforeItLooksAtThem) {
  SessionInbox inbox(Raw());
  const std::vector<PointQuery> bad(6, {1, -1, NAN});
  EXPECT_THAT(inbox.AddPoints("p", bad), StatusIs(kExhausted, HasSubstr("at most 5")));
  Frame frame = RawFrame(0);
  frame.points = bad;
  EXPECT_THAT(Push(inbox, frame), StatusIs(kExhausted, HasSubstr("at most 5")));
  EXPECT_THAT(Push(inbox, RawFrame(0)), IsOk()) << "nothing had changed";
}

TEST(SessionInboxTest, NamesTheFirstViolationsAndCountsTheRest) {
  SessionInbox::Options options = Png();
  options.limits.max_points = 2000;
  SessionInbox inbox(options);
  std::vector<PointQuery> bad(2000, {1, -1, NAN});
  absl::Status status = inbox.AddPoints("p", bad);
  EXPECT_THAT(FieldViolations(status), SizeIs(kMaxFieldViolations));
  EXPECT_THAT(status, StatusIs(kInvalid, HasSubstr("; and 5991 more")));  // two coordinates and the id, but the first
  EXPECT_LT(status.message().size(), 600U);
  // The same for points that are found to be outside when the first frame comes.
  std::vector<PointQuery> outside;
  for (PointId id = 0; id < 2000; ++id) outside.push_back({id, 8, 8});
  ASSERT_THAT(inbox.AddPoints("config.points", outside), IsOk());
  status = Push(inbox, PngFrame(0, 8, 8)).status();
  EXPECT_THAT(FieldViolations(status), SizeIs(kMaxFieldViolations));
  EXPECT_THAT(status, StatusIs(kInvalid, HasSubstr("config.points[0].x: 8 is not in 0 .. 7")));
  EXPECT_THAT(status, StatusIs(kInvalid, HasSubstr("; and 3992 more")));
}

TEST(SessionInboxTest, OfPointsReSeededBeforeTheFirstFrameOnlyTheLastSeedsMatter) {
  SessionInbox inbox(Png());
  for (int i = 0; i < 10'000; ++i) {
    ASSERT_THAT(inbox.AddPoints("p", {{1, 900, 900}, {2, 900, 900}}), IsOk());
    ASSERT_THAT(inbox.RemovePoints({2}), IsOk());
  }
  ASSERT_THAT(inbox.AddPoints("p", {{1, 3, 3}, {2, 4, 4}}), IsOk());
  EXPECT_THAT(Push(inbox, PngFrame(0, 8, 8)), IsOk());
  const std::vector<PointOp> ops = inbox.TakeOps(0);
  ASSERT_THAT(ops, SizeIs(2));
  EXPECT_EQ(ops[0].query.x, 3);
  EXPECT_EQ(ops[0].seeds, 10'001);
  EXPECT_EQ(ops[1].query.x, 4);
}

TEST(SessionInboxTest, RefusesChangesThatPileUpAtOneFrame) {
  SessionInbox inbox(Raw());
  absl::Status status;
  for (PointId id = 0; status.ok() && id < 10'000; ++id) {
    status = inbox.AddPoints("add_points.points", {{id, 1, 1}});
    if (status.ok()) status = inbox.RemovePoints({id});
  }
  EXPECT_THAT(status, StatusIs(kExhausted, HasSubstr("add_points.points: at most 1044 changes")));
}

TEST(SessionInboxTest, BoundsPointsAndFrames) {
  SessionInbox::Options options = Raw();
  options.limits.max_frames = 1;
  SessionInbox inbox(options);
  ASSERT_THAT(inbox.AddPoints("p", {{1}, {2}, {3}, {4}, {5}}), IsOk());
  EXPECT_THAT(inbox.AddPoints("p", {{5}}), IsOk()) << "re-seeding takes no place";
  EXPECT_THAT(inbox.AddPoints("p", {{6}}), StatusIs(kExhausted));
  ASSERT_THAT(inbox.RemovePoints({1, 99}), IsOk());
  EXPECT_THAT(inbox.AddPoints("p", {{6}}), IsOk());
  ASSERT_THAT(Push(inbox, RawFrame(0)), IsOk());
  EXPECT_THAT(Push(inbox, RawFrame(1)), StatusIs(kExhausted));
}

TEST(SessionInboxTest, GivesOperationsInOrderWhenTheirFrameIsThere) {
  SessionInbox inbox(Raw());
  ASSERT_THAT(inbox.AddPoints("p", {{1}}), IsOk());  // the first frame's
  Frame first = RawFrame(0);
  first.points = {{2}};
  ASSERT_THAT(Push(inbox, first), IsOk());
  ASSERT_THAT(inbox.AddPoints("p", {{3}}), IsOk());
  ASSERT_THAT(Push(inbox, RawFrame(1)), IsOk());
  ASSERT_THAT(inbox.RemovePoints({1}), IsOk());
  EXPECT_THAT(inbox.TakeOps(-1), IsEmpty());
  std::vector<PointId> ids;
  for (const PointOp& op : inbox.TakeOps(0)) ids.push_back(op.query.id);
  EXPECT_THAT(ids, ElementsAre(1, 2, 3));
  const auto later = inbox.TakeOps(1);
  ASSERT_THAT(later, SizeIs(1));
  EXPECT_EQ(later[0].kind, PointOp::Kind::kRemove);
}

TEST(SessionInboxTest, AFrameThatDoesNotDecodeEndsTheSessionBeforeIt) {
  SessionInbox inbox(Raw());
  for (int64_t i = 0; i < 3; ++i) {
    Frame frame = RawFrame(i);
    frame.points = {{static_cast<PointId>(i)}};
    ASSERT_THAT(Push(inbox, frame), IsOk());
  }
  inbox.End(absl::OkStatus());
  EXPECT_TRUE(inbox.SetDecoded(1, absl::InvalidArgumentError("broken"), SteadyTime()));
  EXPECT_FALSE(inbox.SetDecoded(2, absl::InvalidArgumentError("too late"), SteadyTime()));
  EXPECT_THAT(inbox.end_status(), StatusIs(kInvalid, HasSubstr("frame 1: broken")));
  EXPECT_EQ(inbox.TakeDropped(), 1);  // frame 2; frame 1 was rejected
  EXPECT_FALSE(inbox.drained());
  Decode(inbox, 0);
  inbox.TakeFrames(1);
  EXPECT_THAT(inbox.TakeOps(2), SizeIs(1));
  EXPECT_TRUE(inbox.drained());
}

TEST(SessionInboxTest, AfterTheEndEveryCallSaysWhy) {
  SessionInbox finished(Raw()), failed(Raw());
  finished.End(absl::OkStatus());
  failed.End(absl::DataLossError("why"));
  failed.End(absl::OkStatus());
  EXPECT_THAT(Push(finished, RawFrame(0)), StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Push(failed, RawFrame(0)), StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(failed.AddPoints("p", {{1}}), StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(failed.RemovePoints({1}), StatusIs(absl::StatusCode::kDataLoss));
}

// It is still to be placed on that frame: a second one would get its points, and their removal.
TEST(SessionInboxTest, AnObjectThatWasRemovedBeforeTheFirstFrameIsNotGivenAnewWithIt) {
  SessionInbox inbox(Raw());
  const ObjectQuery object{7, {}, {{0, 0}, {3, 0}, {3, 1}}, 3};
  ASSERT_THAT(inbox.AddObjects("config.objects", {object}), IsOk());
  ASSERT_THAT(inbox.RemovePoints({ObjectPointId(7, 0), ObjectPointId(7, 1), ObjectPointId(7, 2)}), IsOk());
  Frame first = RawFrame(0), second = RawFrame(1);
  first.objects = second.objects = {object};
  EXPECT_THAT(ViolatedFields(Push(inbox, first).status()), ElementsAre("frame.objects[0].id"));
  ASSERT_THAT(Push(inbox, RawFrame(0)), IsOk());
  EXPECT_THAT(Push(inbox, second), IsOk());
  EXPECT_THAT(inbox.TakeObjects(0), SizeIs(1));
  EXPECT_THAT(inbox.TakeObjects(1), SizeIs(1));
}

TEST(SessionInboxTest, CancellingDropsEverything) {
  SessionInbox inbox(Raw());
  ASSERT_THAT(inbox.AddPoints("p", {{1}}), IsOk());
  ASSERT_THAT(Push(inbox, RawFrame(0)), IsOk());
  inbox.Cancel();
  EXPECT_TRUE(inbox.cancelled());
  EXPECT_TRUE(inbox.drained());
  EXPECT_FALSE(inbox.TakeBytes(0).has_value());
  inbox.SetDecoded(0, Image(), SteadyTime());
  EXPECT_EQ(inbox.ready(), 0);
  EXPECT_EQ(inbox.TakeDropped(), 1);
}

}  // namespace
}  // namespace holdfast
