// SPDX-License-Identifier: Apache-2.0
// Objects in sessions of an engine whose network goes where optical flow leads: what is said of an object is the same
// however the frames come, and whatever else the session does.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
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

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
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

// 'speed': pixels a frame.
Frame FrameAt(int64_t index, bool reseed = true, float speed = 0.4f) {
  static auto& made = *new std::map<std::pair<int64_t, float>, std::string>();
  std::string& bytes = made[{index, speed}];
  if (bytes.empty()) {
    GrayImage picture = ShiftedTexture(kPicture, speed * static_cast<float>(index), 0);
    Cover(picture, kStill, kPicture.width, 9);
    bytes = BytesOf(picture);
  }
  Frame frame{index, bytes, {}, {}};
  if (index == 3) {
    frame.objects = {TheObject()};
    frame.objects[0].reseed = reseed;
  }
  return frame;
}

// The final word on the object and its points.
struct SaidOfObject {
  FinalObject object;
  std::map<PointId, FinalTrack> points;
};

SaidOfObject SaidBy(const RecordingListener& listener) {
  SaidOfObject told{listener.FinalOfObject(kObject), {}};
  for (const auto& [id, track] : listener.Finals()) {
    if (IsObjectPoint(id) && ObjectOf(id) == kObject && !track.empty()) told.points[id] = track;
  }
  return told;
}

class ObjectsEngineTest : public EngineTest {
 protected:
  ObjectsEngineTest() {
    options_.sealer = &sealer_;
    model_->keep_starts = true;
    model_->step = 0;
  }
  // A session that is over may still be sealing a checkpoint.
  ~ObjectsEngineTest() override { engine_.reset(); }
  static SessionConfig MakeConfig() {
    SessionConfig config = Config();
    config.raw_size = config.processing_size = kPicture;
    return config;
  }
  void Say(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) const {
    for (int64_t i = begin; i < end; ++i) {
      ASSERT_THAT(listener.Push(session, FrameAt(i, reseed_, speed_)), IsOk());
      if (i != removal_frame_) continue;
      ASSERT_THAT(session.RemovePoints(removed_), IsOk());
    }
  }
  SaidOfObject Track(const SessionConfig& config) {
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, kFrames);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    return SaidBy(listener);
  }
  // What is told by a session that is interrupted behind frame end - 1, with or without a warning, and goes on.
  SaidOfObject TrackInterrupted(const SessionConfig& config, int64_t end, bool warned) {
    RecordingListener first, second;
    auto session = Open(config, first);
    Say(*session, first, 0, end);
    if (warned) {
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
    SaidOfObject joined = SaidBy(first);
    for (const auto& [frame, sample] : second.FinalOfObject(kObject)) {
      const auto [place, inserted] = joined.object.emplace(frame, sample);
      EXPECT_TRUE(SameObjectSamples(place->second, sample)) << "frame " << frame;
    }
    for (const auto& [id, track] : SaidBy(second).points) {
      for (const auto& [frame, sample] : track) {
        EXPECT_EQ(joined.points[id].emplace(frame, sample).first->second, sample) << id << " on frame " << frame;
      }
    }
    return joined;
  }
  // Another engine, at whose options one may still look.
  void Restart() {
    if (engine_ == nullptr) delete model_;  // no engine has taken it
    engine_.reset();
    options_ = EngineOptions();
    options_.sealer = &sealer_;
    model_ = new FakeTrackerModel;
    model_->keep_starts = true;
    model_->step = 0;
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
  bool reseed_ = true;
  float speed_ = 0.4f;
  int64_t removal_frame_ = -1;
  std::vector<PointId> removed_;
};

void ExpectSame(const SaidOfObject& a, const SaidOfObject& b) {
  ASSERT_EQ(a.object.size(), b.object.size());
  for (const auto& [frame, sample] : a.object) {
    ASSERT_EQ(b.object.count(frame), 1u) << frame;
    EXPECT_TRUE(SameObjectSamples(sample, b.object.at(frame))) << "frame " << frame;
  }
  EXPECT_EQ(a.points, b.points);
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
  EXPECT_EQ(listener.summary().points, static_cast<int64_t>(listener.Finals().size()));
}

TEST_F(ObjectsEngineTest, PointsThatHaveLeftArePlacedAnewAndEnd) {
  const SaidOfObject told = Track(MakeConfig());
  int placed_anew = 0;
  for (const auto& [id, track] : told.points) {
    const int64_t begin = track.begin()->first, end = track.rbegin()->first + 1;
    const auto next = told.points.find(ObjectSuccessor(id));
    EXPECT_EQ(end, next == told.points.end() ? kFrames : next->second.begin()->first + 16) << "with its window";
    if (!IsPlacedAnew(id)) continue;
    ++placed_anew;
    EXPECT_EQ((begin - 3) % 8, 0) << "where windows meet";
    EXPECT_THAT(told.object.at(begin + 1).joined, Contains(id));
    for (const auto* left : {&told.object.at(begin).left, &told.object.at(begin + 15).left}) {
      EXPECT_THAT(*left, Contains(id - kMaxObjectPoints));
    }
  }
  EXPECT_GE(placed_anew, 1);
  for (const auto& [frame, sample] : told.object) {
    EXPECT_LE(sample.joined.size(), 6u) << "at most a quarter at a time";
    int64_t live = 0;
    for (const auto& [id, track] : told.points) {
      live += track.count(frame) != 0 && told.points.count(ObjectSuccessor(id)) == 0 ? 1 : 0;
    }
    EXPECT_LE(live, 24);
  }
}

TEST_F(ObjectsEngineTest, NobodyIsPlacedAnewWhoIsNotWanted) {
  reseed_ = false;
  const SaidOfObject told = Track(MakeConfig());
  EXPECT_THAT(told.points, SizeIs(24));
  EXPECT_THAT(told.object.at(40).left, Not(IsEmpty()));
}

TEST_F(ObjectsEngineTest, WhatIsSaidOfItDependsOnNothingElse) {
  const SaidOfObject alone = Track(MakeConfig());
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
  const SaidOfObject narrow = Track(MakeConfig());
  Restart();
  ExpectSame(Track(MakeConfig()), narrow);
}

TEST_F(ObjectsEngineTest, NeitherHopNorPictureNorPaceMatterToThat) {
  for (const int hop : {1, 5, 23}) {
    for (const bool flow : {true, false}) {
      SCOPED_TRACE(testing::Message() << "hop " << hop << ", with optical flow: " << flow);
      SessionConfig config = MakeConfig();
      config.hop_frames = hop;
      speed_ = 0.44f;  // some have left when windows meet first
      config.motion_prior = config.polish = flow;
      Restart();
      const SaidOfObject wide = Track(config);
      EXPECT_TRUE(!flow || wide.points.size() > 24);
      Restart();
      options_.max_batch_rows = 7;
      options_.max_pending_frames = 2;
      ExpectSame(Track(config), wide);
      config.checkpoint_interval_frames = 3;
      ExpectSame(TrackInterrupted(config, 42, /*warned=*/true), wide);
      ExpectSame(TrackInterrupted(config, 51, /*warned=*/false), wide);
    }
  }
}

TEST_F(ObjectsEngineTest, ARemovalMeansWhoeverStandsAtThePlace) {
  const SaidOfObject whole = Track(MakeConfig());
  const auto anew = std::find_if(whole.points.begin(), whole.points.end(),
                                 [](const auto& point) { return IsPlacedAnew(point.first); });
  ASSERT_NE(anew, whole.points.end());
  const PointId id = anew->first;
  const int64_t placed = anew->second.begin()->first;
  // Before it is decided on, while it is, and after.
  for (const int64_t frame : {placed + 14, placed + 15, placed + 16}) {
    ASSERT_LT(frame, kFrames);
    SCOPED_TRACE(frame - placed);
    removal_frame_ = frame;
    removed_ = {ObjectPlace(id), ObjectPointId(kObject, 0)};
    Restart();
    SessionConfig config = MakeConfig();
    config.checkpoint_interval_frames = 3;
    const SaidOfObject told = Track(config);
    EXPECT_EQ(told.points.count(id), frame == placed + 14 ? 0u : 1u);
    EXPECT_LE(told.points.at(ObjectPlace(id)).rbegin()->first, frame);
    ExpectSame(TrackInterrupted(config, frame + 1, /*warned=*/true), told);
    ExpectSame(TrackInterrupted(config, std::min(frame + 4, kFrames), /*warned=*/false), told);
    Restart();
    options_.max_batch_rows = 5;
    options_.max_pending_frames = 1;
    ExpectSame(Track(config), told);
  }
}

TEST_F(ObjectsEngineTest, PointsThatArePlacedAnewTakeNoRoomFromOthers) {
  options_.limits.max_points = 26;
  RecordingListener listener;
  auto session = Open(MakeConfig(), listener);
  Say(*session, listener, 0, 50);
  EXPECT_THAT(session->AddPoints({{1, 5, 5}, {2, 9, 9}}), IsOk());
  EXPECT_THAT(session->AddPoints({{3, 5, 5}}), StatusIs(absl::StatusCode::kResourceExhausted));
  Say(*session, listener, 50, kFrames);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_GT(listener.summary().points, 26);
}

TEST_F(ObjectsEngineTest, GoesOnElsewhereAsIfNothingHadHappened) {
  SessionConfig config = MakeConfig();
  config.checkpoint_interval_frames = 5;
  const SaidOfObject expected = Track(config);
  for (int64_t end = 2; end < kFrames; end += 3) {
    SCOPED_TRACE(end);
    ExpectSame(TrackInterrupted(config, end, /*warned=*/end % 2 == 0), expected);
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
  EXPECT_EQ(object.size(), 47u);
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
