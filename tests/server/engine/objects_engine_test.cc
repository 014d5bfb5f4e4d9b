// SPDX-License-Identifier: Apache-2.0
// Objects in sessions of an engine whose network goes where optical flow leads: what is said of an object is the same
// however the frames come, and whatever else the session does.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/server/engine/engine_fixture.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/moving_picture.h"
#include "tests/support/violated_fields.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::Ge;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Le;
using ::testing::SizeIs;

constexpr int64_t kFrames = 60;
constexpr ObjectId kObject = 7;
constexpr int kStill = 84;  // columns from here on stand still

std::string MaskPng(const cv::Rect& where, ImageSize size = kPicture) {
  cv::Mat mask(size.height, size.width, CV_8UC1, cv::Scalar(0));
  cv::rectangle(mask, where, cv::Scalar(1), cv::FILLED);
  std::vector<uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(".png", mask, bytes));
  return {bytes.begin(), bytes.end()};
}

// Most of it lies on what moves to the right, and a tenth on what stands still: points there leave it.
ObjectQuery TheObject() {
  ObjectQuery object;
  object.id = kObject;
  object.mask_png = MaskPng({20, 30, 74, 40});
  object.points = 24;
  return object;
}

Frame FrameAt(int64_t index) {
  static auto& made = *new std::map<int64_t, std::string>();
  std::string& bytes = made[index];
  if (bytes.empty()) {
    GrayImage picture = ShiftedTexture(kPicture, 0.4f * static_cast<float>(index), 0);
    Cover(picture, kStill, kPicture.width, 9);
    bytes = BytesOf(picture);
  }
  Frame frame{index, bytes, {}, {}};
  if (index == 3) frame.objects = {TheObject()};
  return frame;
}

class ObjectsEngineTest : public EngineTest {
 protected:
  ObjectsEngineTest() {
    options_.sealer = &sealer_;
    model_->keep_starts = true;
    model_->step = 0;
  }
  static SessionConfig MakeConfig() {
    SessionConfig config = Config();
    config.raw_size = config.processing_size = kPicture;
    return config;
  }
  static void Say(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) ASSERT_THAT(listener.Push(session, FrameAt(i)), IsOk());
  }
  FinalObject Track(const SessionConfig& config) {
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, kFrames);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    return listener.FinalOfObject(kObject);
  }
  absl::Status Refusal(const SessionConfig& config) {
    RecordingListener listener;
    return engine().OpenSession(config, listener).status();
  }
  // How a session ends that gets this as its first frame.
  absl::Status EndOf(const ObjectQuery& object) {
    RecordingListener listener;
    auto session = Open(MakeConfig(), listener);
    Frame frame = FrameAt(0);
    frame.objects = {object};
    absl::Status status = listener.Push(*session, frame).status();
    if (!status.ok()) return status;
    session->Finish();
    return listener.AwaitDone();
  }

  MemorySealer sealer_;
};

void ExpectSame(const FinalObject& a, const FinalObject& b) {
  ASSERT_EQ(a.size(), b.size());
  for (const auto& [frame, sample] : a) {
    ASSERT_EQ(b.count(frame), 1u) << frame;
    EXPECT_TRUE(SameObjectSamples(sample, b.at(frame))) << "frame " << frame;
  }
}

TEST_F(ObjectsEngineTest, FollowsTheObjectAndTellsWhichPointsHaveLeft) {
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  Say(*session, listener, 0, kFrames);
  session->Finish();
  ASSERT_THAT(listener.AwaitDone(), IsOk());
  const FinalObject object = listener.FinalOfObject(kObject);
  ASSERT_EQ(object.size(), size_t{kFrames - 3});
  EXPECT_NEAR(object.at(3).centre.x, 56.5, 1e-4);
  EXPECT_NEAR(object.at(3).centre.y, 49.5, 1e-4);
  EXPECT_THAT(object.at(3).outline, SizeIs(4));
  EXPECT_NEAR(object.at(40).centre.x, 56.5 + 0.4 * 37, 0.5);
  EXPECT_NEAR(object.at(40).scale, 1, 0.02);
  EXPECT_NEAR(object.at(40).outline[0].y, object.at(3).outline[0].y, 1);
  EXPECT_THAT(object.at(3).left, IsEmpty());
  ASSERT_FALSE(object.at(40).left.empty());
  for (const PointId id : object.at(40).left) {
    EXPECT_EQ(ObjectOf(id), kObject);
    EXPECT_GE(listener.Final(id).at(3).x, kStill - 4) << "point " << (id & 0xFF) << " moves with the object";
  }
  EXPECT_EQ(listener.summary().points, 24);
}

TEST_F(ObjectsEngineTest, WhatIsSaidOfItDependsOnNothingElse) {
  const FinalObject alone = Track(MakeConfig());
  SessionConfig beside = MakeConfig();
  beside.points = {{1, 30, 40}, {2, 100, 20}};
  ObjectQuery other = TheObject();
  other.id = 1;
  beside.objects = {other};
  ExpectSame(Track(beside), alone);
  SessionConfig live = MakeConfig();
  live.emit = Emit::kEveryFrame;
  ExpectSame(Track(live), alone);
  SessionConfig quiet = MakeConfig();
  quiet.send_provisional = false;
  ExpectSame(Track(quiet), alone);
}

TEST_F(ObjectsEngineTest, SmallBatchesChangeNothing) {
  options_.max_batch_rows = 5;
  options_.max_batch_frames = 1;
  options_.max_pending_frames = 1;
  const FinalObject narrow = Track(MakeConfig());
  engine_.reset();
  options_ = EngineOptions();
  model_ = new FakeTrackerModel;
  model_->keep_starts = true;
  model_->step = 0;
  ExpectSame(Track(MakeConfig()), narrow);
}

TEST_F(ObjectsEngineTest, GoesOnElsewhereAsIfNothingHadHappened) {
  SessionConfig config = MakeConfig();
  config.checkpoint_interval_frames = 5;
  const FinalObject expected = Track(config);
  for (int64_t end = 2; end < kFrames; end += 3) {
    SCOPED_TRACE(end);
    RecordingListener first, second;
    auto session = Open(config, first);
    Say(*session, first, 0, end);
    if (end % 2 == 0) {
      session->Suspend(absl::UnavailableError("going away"));
      (void)first.AwaitDone();
    }
    session.reset();
    SessionConfig resumed = config;
    int64_t begin = 0;
    if (!first.checkpoints().empty()) {
      resumed.resume_token = first.checkpoints().back().token;
      begin = first.checkpoints().back().next_frame;
    }
    session = Open(resumed, second);
    Say(*session, second, begin, kFrames);
    session->Finish();
    EXPECT_THAT(second.AwaitDone(), IsOk());
    FinalObject joined = first.FinalOfObject(kObject);
    for (const auto& [frame, sample] : second.FinalOfObject(kObject)) {
      const auto [place, inserted] = joined.emplace(frame, sample);
      EXPECT_TRUE(SameObjectSamples(place->second, sample)) << "frame " << frame;
    }
    ExpectSame(joined, expected);
  }
}

TEST_F(ObjectsEngineTest, EveryFrameIsAnsweredForObjectsToo) {
  SessionConfig config = MakeConfig();
  config.emit = Emit::kEveryFrame;
  RecordingListener listener;
  auto session = Open(config, listener);
  Say(*session, listener, 0, 6);
  bool answered = false;
  for (size_t count = 1; !answered; ++count) {
    listener.AwaitUpdates(count);
    for (const TrackUpdate& update : listener.updates()) {
      for (const ObjectRun& run : update.objects) {
        answered |= run.first_frame + static_cast<int64_t>(run.samples.size()) == 6;
      }
    }
  }
  session->Cancel();
}

TEST_F(ObjectsEngineTest, EndsWithItsLastPoint) {
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  Say(*session, listener, 0, 20);
  std::vector<PointId> ids;
  for (uint32_t i = 0; i < 24; ++i) ids.push_back(ObjectPointId(kObject, i));
  EXPECT_THAT(session->RemovePoints(ids), IsOk());
  Frame again = FrameAt(20);
  again.objects = {TheObject()};  // the id is free
  ASSERT_THAT(listener.Push(*session, again), IsOk());
  Say(*session, listener, 21, 50);
  session->Finish();
  ASSERT_THAT(listener.AwaitDone(), IsOk());
  const FinalObject object = listener.FinalOfObject(kObject);
  // The last window that was due before the end came to frame 18.
  EXPECT_EQ(object.size(), 46u);
  EXPECT_NEAR(object.at(18).centre.x, 56.5 + 0.4 * 15, 1.5);
  EXPECT_NEAR(object.at(20).centre.x, 56.5, 1e-4);
  EXPECT_EQ(listener.summary().points, 48);
}

TEST_F(ObjectsEngineTest, APolygonIsAsGoodAsAMask) {
  SessionConfig config = MakeConfig();
  ObjectQuery object;
  object.id = 1;
  object.polygon = {{20, 30}, {60, 30}, {60, 60}, {20, 60}};
  config.objects = {object};
  RecordingListener listener;
  auto session = Open(config, listener);
  ASSERT_THAT(listener.Push(*session, FrameAt(0)), IsOk());
  session->Finish();
  ASSERT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_NEAR(listener.FinalOfObject(1).at(0).centre.x, 40, 1e-4);
  EXPECT_EQ(listener.summary().points, 64);
}

TEST_F(ObjectsEngineTest, WhatIsWrongWithAnObjectIsNamed) {
  ObjectQuery object = TheObject();
  object.mask_png = MaskPng({1, 1, 5, 5}, {64, 64});
  EXPECT_THAT(ViolatedFields(EndOf(object)), ElementsAre("frame.objects[0].mask_png"));
  object.mask_png = MaskPng({0, 0, 0, 0});
  EXPECT_THAT(EndOf(object).message(), HasSubstr("has room for 0 points"));
  object.mask_png = MaskPng({4, 4, 2, 1});
  EXPECT_THAT(ViolatedFields(EndOf(object)), ElementsAre("frame.objects[0]"));
  object.mask_png = MaskPng({20, 30, 74, 40});
  object.mask_png[object.mask_png.size() / 2] ^= 0x55;
  EXPECT_THAT(EndOf(object), StatusIs(absl::StatusCode::kInvalidArgument));
  object.mask_png = "no picture";
  EXPECT_THAT(ViolatedFields(EndOf(object)), ElementsAre("frame.objects[0].mask_png"));
  object.polygon = {{1, 1}, {9, 1}, {5, 9}};
  EXPECT_THAT(EndOf(object).message(), HasSubstr("a mask or a polygon"));
  object.mask_png.clear();
  object.polygon.pop_back();
  object.points = 1000;
  EXPECT_THAT(ViolatedFields(EndOf(object)), ElementsAre("frame.objects[0].points", "frame.objects[0].polygon"));
  object = TheObject();
  object.mask_png.clear();
  object.polygon = {{1, 1}, {9, 1}, {5, 96}};
  EXPECT_THAT(ViolatedFields(EndOf(object)), ElementsAre("frame.objects[0].polygon[2]"));
}

TEST_F(ObjectsEngineTest, ObjectsOfTheConfigurationAreHeldAgainstTheFirstFrame) {
  SessionConfig config = MakeConfig();
  config.encoding = FrameEncoding::kPng;
  config.raw_size = {};
  config.objects = {TheObject()};
  RecordingListener listener;
  auto session = Open(config, listener);
  Frame frame;
  frame.bytes = MaskPng({1, 1, 4, 4}, {64, 64});
  EXPECT_THAT(ViolatedFields(listener.Push(*session, frame).status()), ElementsAre("config.objects[0].mask_png"));
}

TEST_F(ObjectsEngineTest, ObjectsCountAsTheirPointsAndShareNoIds) {
  options_.limits.max_points = 100;
  SessionConfig config = MakeConfig();
  config.objects = {TheObject(), TheObject()};
  EXPECT_THAT(ViolatedFields(Refusal(config)), ElementsAre("config.objects[1].id"));
  config.objects[1].id = 8;
  config.objects[1].points = 80;
  EXPECT_THAT(Refusal(config), StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("at most 100")));
  config.objects[1].points = 70;
  config.points = {{ObjectPointId(3, 0), 1, 1}};
  EXPECT_THAT(ViolatedFields(Refusal(config)), ElementsAre("config.objects"));
  config.points = {{3, 1, 1}};
  RecordingListener listener;
  auto session = Open(config, listener);
  EXPECT_THAT(ViolatedFields(session->AddPoints({{1, 2, 2}, {ObjectPointId(3, 0), 1, 1}})),
              ElementsAre("add_points.points[1].id"));
  ASSERT_THAT(listener.Push(*session, FrameAt(0)), IsOk());
  Frame next = FrameAt(1);
  next.objects = {TheObject()};
  next.objects[0].points = 3;
  EXPECT_THAT(ViolatedFields(listener.Push(*session, next).status()), ElementsAre("frame.objects[0].id"));
}

}  // namespace
}  // namespace holdfast
