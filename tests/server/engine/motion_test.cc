// SPDX-License-Identifier: Apache-2.0
// Optical flow under the network, through the engine: windows that start where flow leads, final positions moved to
// where the picture says, an estimate on every frame; and that none of it depends on pace, batches or other points.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tests/server/engine/engine_fixture.h"
#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr float kSpeedX = 0.75f, kSpeedY = 0.25f;  // pixels a frame
constexpr PointQuery kPoint{7, 40.5f, 50.25f};

Frame PictureFrame(int64_t index, std::vector<PointQuery> points = {}) {
  const auto t = static_cast<float>(index);
  return {index, BytesOf(ShiftedTexture(kPicture, kSpeedX * t, kSpeedY * t)), {}, std::move(points)};
}

SessionConfig PictureConfig(std::vector<PointQuery> points, int hop = 8) {
  SessionConfig config = Config(std::move(points), hop);
  config.raw_size = config.processing_size = kPicture;
  return config;
}

// As PictureConfig, with an estimate on every frame.
SessionConfig LiveConfig(std::vector<PointQuery> points) {
  SessionConfig config = PictureConfig(std::move(points));
  config.emit = Emit::kEveryFrame;
  return config;
}

std::vector<PointQuery> Crowd(int count) {
  std::vector<PointQuery> points;
  for (int i = 0; i < count; ++i) {
    points.push_back(
        {static_cast<PointId>(100 + i), 20 + 1.3f * static_cast<float>(i), 30 + 0.7f * static_cast<float>(i)});
  }
  return points;
}

// A network that finds nothing by itself: its estimates are its starts.
class MotionTest : public EngineTest {
 protected:
  MotionTest() {
    model_->keep_starts = true;
    model_->step = 0;
  }

  FinalTrack Track(const SessionConfig& config, int64_t frames, RecordingListener& listener, PointId id = kPoint.id) {
    auto session = Open(config, listener);
    for (int64_t i = 0; i < frames; ++i) EXPECT_THAT(listener.Push(*session, PictureFrame(i)), IsOk());
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    return listener.Final(id);
  }
  FinalTrack Track(const SessionConfig& config, int64_t frames) {
    RecordingListener listener;
    return Track(config, frames, listener);
  }
};

void ExpectFollows(const FinalTrack& track, float tolerance) {
  for (const auto& [frame, sample] : track) {
    EXPECT_NEAR(sample.x, kPoint.x + kSpeedX * static_cast<float>(frame), tolerance) << "frame " << frame;
    EXPECT_NEAR(sample.y, kPoint.y + kSpeedY * static_cast<float>(frame), tolerance) << "frame " << frame;
  }
}

TEST_F(MotionTest, WindowsStartWhereFlowLeads) {
  SessionConfig config = PictureConfig({kPoint});
  config.polish = false;
  const FinalTrack track = Track(config, 60);
  ASSERT_THAT(track, SizeIs(60));
  ExpectFollows(track, 1.0f);
}

TEST_F(MotionTest, WithoutTheMotionPriorWindowsStartWhereThePointWas) {
  SessionConfig config = PictureConfig({kPoint});
  config.motion_prior = config.polish = false;
  for (const auto& [frame, sample] : Track(config, 60)) EXPECT_FLOAT_EQ(sample.x, kPoint.x) << "frame " << frame;
  EXPECT_EQ(metrics_.totals().stages[Stage::kFlow], 0) << "nothing asked for flow";
}

TEST_F(MotionTest, PolishMovesFinalPositionsToWhereThePictureSays) {
  model_->step = 0.03f;  // each window moves estimates off by a quarter of a pixel
  SessionConfig config = PictureConfig({kPoint});
  config.polish = true;
  const FinalTrack polished = Track(config, 40);
  config.polish = false;
  const FinalTrack rough = Track(config, 40);
  ASSERT_THAT(polished, SizeIs(40));
  ExpectFollows(polished, 0.25f);
  EXPECT_GT(rough.at(30).x, kPoint.x + kSpeedX * 30 + 0.4f);
  EXPECT_EQ(polished.at(0), rough.at(0));
  for (const auto& [frame, sample] : polished) EXPECT_EQ(sample.confidence, rough.at(frame).confidence);
}

TEST_F(MotionTest, PolishAloneNeedsNoMotionPrior) {
  model_->keep_starts = false;
  model_->step = kSpeedX / 8;  // the network keeps to the row of the query, which the point leaves
  SessionConfig config = PictureConfig({kPoint});
  config.motion_prior = false;
  config.polish = true;
  FinalTrack track = Track(config, 40);
  track.erase(track.upper_bound(8), track.end());
  ASSERT_THAT(track, SizeIs(9));
  ExpectFollows(track, 0.25f);
}

TEST_F(MotionTest, HiddenPointsAreNotPolished) {
  model_->step = 0.03f;
  model_->similarity = 0;  // nothing is visible
  SessionConfig config = PictureConfig({kPoint});
  config.polish = true;
  const FinalTrack hidden = Track(config, 40);
  config.polish = false;
  EXPECT_EQ(hidden, Track(config, 40));
}

TEST_F(MotionTest, APointDoesNotDependOnOthersNorOnHowItCame) {
  RecordingListener alone, crowd;
  auto a = Open(PictureConfig({}), alone), b = Open(PictureConfig(Crowd(60)), crowd);
  const PointQuery point{5, 60, 40};
  for (int64_t i = 0; i < 70; ++i) {
    ASSERT_THAT(alone.Push(*a, PictureFrame(i, i == 10 ? std::vector<PointQuery>{point} : std::vector<PointQuery>{})),
                IsOk());
    ASSERT_THAT(crowd.Push(*b, PictureFrame(i)), IsOk());
    if (i == 10) {
      ASSERT_THAT(b->AddPoints({point}), IsOk());
    }
    if (i == 30) {
      ASSERT_THAT(b->RemovePoints({101, 102}), IsOk());
    }
  }
  a->Finish();
  b->Finish();
  EXPECT_THAT(alone.AwaitDone(), IsOk());
  EXPECT_THAT(crowd.AwaitDone(), IsOk());
  EXPECT_THAT(alone.Final(5), SizeIs(60));
  EXPECT_EQ(alone.Final(5), crowd.Final(5));
}

TEST_F(MotionTest, FinalTracksDoNotDependOnPaceBatchesOrWhenTheyAreSent) {
  const auto points = [] {
    std::vector<PointQuery> all = Crowd(20);
    all.push_back(kPoint);
    return all;
  };
  model_->step = 0.05f;
  const FinalTrack expected = Track(PictureConfig(points()), 75);
  ASSERT_THAT(expected, SizeIs(75));

  SessionConfig every_frame = LiveConfig(points());
  EXPECT_EQ(Track(every_frame, 75), expected);

  SessionConfig final_only = PictureConfig(points());
  final_only.send_provisional = false;
  EXPECT_EQ(Track(final_only, 75), expected);

  for (const Emit emit : {Emit::kWindows, Emit::kEveryFrame}) {  // frame by frame
    SessionConfig config = PictureConfig(points());
    config.emit = emit;
    RecordingListener slow;
    auto session = Open(config, slow);
    for (int64_t i = 0; i < 75; ++i) {
      ASSERT_THAT(slow.Push(*session, PictureFrame(i)), IsOk());
      if (i % 8 == 7) slow.AwaitFinal(kPoint.id, i < 23 ? 1 : static_cast<size_t>(i - 14));
    }
    session->Finish();
    EXPECT_THAT(slow.AwaitDone(), IsOk());
    EXPECT_EQ(slow.Final(kPoint.id), expected);
  }
}

// The texture changes, so that points are found by the frame before rather than by their queries.
Frame ChangingFrame(int64_t index, ImageSize size) {
  const auto t = static_cast<float>(index);
  GrayImage picture = ShiftedTexture(size, kSpeedX * t, kSpeedY * t);
  const GrayImage other = ShiftedTexture(size, kSpeedX * t, kSpeedY * t, /*seed=*/50);
  const float part = std::min(0.6f, 0.03f * t);
  for (size_t i = 0; i < picture.pixels.size(); ++i) {
    const float grey = (1 - part) * static_cast<float>(picture.pixels[i]) + part * static_cast<float>(other.pixels[i]);
    picture.pixels[i] = static_cast<uint8_t>(grey);
  }
  return {index, BytesOf(picture)};
}

// Positions are rounded where a feature pixel is not a power of two of the pixels that flow sees: here it is 12.
TEST_F(MotionTest, PolishedPositionsDoNotDependOnThePaceWhereTheyAreRounded) {
  constexpr ImageSize kLarge{192, 144};
  constexpr int64_t kSent = 75;
  SessionConfig config = PictureConfig({});
  config.raw_size = kLarge;
  for (int i = 0; i < 40; ++i) {
    const auto t = static_cast<float>(i);
    config.points.push_back({static_cast<PointId>(i), 20.3f + 3.7f * t, 25.1f + 2.3f * t});
  }
  std::vector<Frame> frames;
  for (int64_t i = 0; i < kSent; ++i) frames.push_back(ChangingFrame(i, kLarge));
  model_->step = 0.05f;
  RecordingListener listeners[2];
  for (const bool slowly : {false, true}) {
    RecordingListener& listener = listeners[slowly ? 1 : 0];
    auto session = Open(config, listener);
    for (int64_t i = 0; i < kSent; ++i) {
      ASSERT_THAT(listener.Push(*session, frames[i]), IsOk());
      if (slowly && i >= 23) listener.AwaitFinal(39, static_cast<size_t>((i - 23) / 8 * 8 + 9));
    }
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
  }
  for (const PointQuery& point : config.points) {
    EXPECT_THAT(listeners[1].Final(point.id), SizeIs(kSent));
    EXPECT_EQ(listeners[1].Final(point.id), listeners[0].Final(point.id)) << point.id;
  }
}

TEST_F(MotionTest, SmallBatchesAndManyThreadsChangeNothing) {
  SessionConfig config = PictureConfig(Crowd(20));
  config.points.push_back(kPoint);
  model_->step = 0.05f;
  options_.max_batch_rows = 3;
  options_.max_batch_frames = 1;
  options_.max_pending_frames = 3;
  options_.decode_threads = 4;
  const FinalTrack in_pieces = Track(config, 75);
  engine_.reset();
  auto model = std::make_unique<FakeTrackerModel>();
  model->keep_starts = true;
  model->step = 0.05f;
  model_ = model.release();
  options_ = {};
  EXPECT_EQ(in_pieces, Track(config, 75));
}

TEST_F(MotionTest, EveryFrameIsAnsweredWhileTheNetworkIsBusy) {
  Gate gate;
  model_->before_encode = [&gate] { gate.Pass(); };
  SessionConfig config = LiveConfig({kPoint});
  RecordingListener listener;
  auto session = Open(config, listener);
  for (int64_t i = 0; i < 6; ++i) {
    ASSERT_THAT(listener.Push(*session, PictureFrame(i)), IsOk());
    listener.AwaitUpdates(static_cast<size_t>(i + 1));
  }
  EXPECT_EQ(metrics_.totals().stages[Stage::kEncode], 0);
  const std::vector<TrackUpdate> updates = listener.updates();
  ASSERT_THAT(updates, SizeIs(6));
  for (size_t i = 0; i < updates.size(); ++i) {
    ASSERT_THAT(updates[i].runs, SizeIs(1));
    const PointRun& run = updates[i].runs[0];
    EXPECT_EQ(run.first_frame, static_cast<int64_t>(i));
    ASSERT_THAT(run.x, SizeIs(1));
    EXPECT_EQ(run.final_count, 0);
    EXPECT_NEAR(run.x[0], kPoint.x + kSpeedX * static_cast<float>(i), 0.3f);
    EXPECT_EQ(run.visible[0], 1);
    EXPECT_EQ(updates[i].frames_processed, 0);
  }
  EXPECT_THAT(metrics_.totals().first, SizeIs(6)) << "the latency of first estimates counts them";
  gate.Open();
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_THAT(listener.Final(kPoint.id), SizeIs(6));
  EXPECT_THAT(metrics_.totals().first, SizeIs(6));
}

TEST_F(MotionTest, APointThatIsCoveredIsAnsweredWithLittleConfidence) {
  Gate gate;
  model_->before_encode = [&gate] { gate.Pass(); };
  SessionConfig config = LiveConfig({kPoint});
  RecordingListener listener;
  auto session = Open(config, listener);
  ASSERT_THAT(listener.Push(*session, PictureFrame(0)), IsOk());
  GrayImage covered = ShiftedTexture(kPicture, kSpeedX, kSpeedY);
  Cover(covered, 10, 80, /*seed=*/9);
  ASSERT_THAT(listener.Push(*session, {1, BytesOf(covered)}), IsOk());
  listener.AwaitUpdates(2);
  const PointRun run = listener.updates().at(1).runs.at(0);
  EXPECT_EQ(run.visible.at(0), 0);
  EXPECT_LE(run.confidence.at(0), 0.5f);
  EXPECT_FLOAT_EQ(run.x.at(0), kPoint.x);
  gate.Open();
}

// Grey on frames 12 .. 14, after which all of it has jumped.
Frame JumpingFrame(int64_t index) {
  const auto t = static_cast<float>(index);
  const float jump_x = index < 12 ? 0 : 12, jump_y = index < 12 ? 0 : -6;
  GrayImage picture = ShiftedTexture(kPicture, kSpeedX * t + jump_x, kSpeedY * t + jump_y);
  if (index >= 12 && index < 15) std::fill(picture.pixels.begin(), picture.pixels.end(), uint8_t{128});
  return {index, BytesOf(picture)};
}

TEST_F(MotionTest, APointThatFlowHasLostIsFoundAgainHoweverItsFramesCome) {
  std::vector<FinalTrack> tracks;
  for (const Emit emit : {Emit::kWindows, Emit::kEveryFrame}) {
    for (const bool slowly : {false, true}) {
      SessionConfig config = PictureConfig(slowly ? Crowd(20) : std::vector<PointQuery>{});
      config.points.push_back(kPoint);
      config.emit = emit;
      config.polish = false;
      RecordingListener listener;
      auto session = Open(config, listener);
      for (int64_t i = 0; i < 50; ++i) {
        ASSERT_THAT(listener.Push(*session, JumpingFrame(i)), IsOk());
        if (slowly && i % 8 == 7) listener.AwaitFinal(kPoint.id, i < 23 ? 1 : static_cast<size_t>(i - 14));
      }
      session->Finish();
      EXPECT_THAT(listener.AwaitDone(), IsOk());
      tracks.push_back(listener.Final(kPoint.id));
    }
  }
  ASSERT_THAT(tracks[0], SizeIs(50));
  for (int64_t frame = 15; frame < 50; ++frame) {  // the first window, which is full with frame 23, knows where it is
    EXPECT_NEAR(tracks[0].at(frame).x, kPoint.x + 12 + kSpeedX * static_cast<float>(frame), 1) << "frame " << frame;
    EXPECT_NEAR(tracks[0].at(frame).y, kPoint.y - 6 + kSpeedY * static_cast<float>(frame), 1) << "frame " << frame;
  }
  for (const FinalTrack& track : tracks) EXPECT_EQ(track, tracks[0]);
}

TEST_F(MotionTest, RemovedPointsAreNotAnsweredAndReSeededOnesAtOnce) {
  Gate gate;
  model_->before_encode = [&gate] { gate.Pass(); };
  SessionConfig config = LiveConfig({kPoint, {8, 80, 50}});
  RecordingListener listener;
  auto session = Open(config, listener);
  ASSERT_THAT(listener.Push(*session, PictureFrame(0)), IsOk());
  listener.AwaitUpdates(1);
  ASSERT_THAT(session->RemovePoints({8}), IsOk());
  ASSERT_THAT(listener.Push(*session, PictureFrame(1, {{kPoint.id, 90, 20}})), IsOk());
  listener.AwaitUpdates(2);
  const TrackUpdate update = listener.updates().at(1);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_EQ(update.runs[0].id, kPoint.id);
  EXPECT_EQ(update.runs[0].first_frame, 1);
  EXPECT_THAT(update.runs[0].x, ::testing::ElementsAre(90.0f));
  gate.Open();
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
}

TEST_F(MotionTest, CaptureTimesComeBackWithTheirFrames) {
  for (const Emit emit : {Emit::kWindows, Emit::kEveryFrame}) {
    SessionConfig config = PictureConfig({kPoint});
    config.emit = emit;
    RecordingListener listener;
    auto session = Open(config, listener);
    for (int64_t i = 0; i < 40; ++i) {
      Frame frame = PictureFrame(i);
      if (i != 3) frame.capture_time = absl::FromUnixMillis(1000 + 33 * i);
      ASSERT_THAT(listener.Push(*session, std::move(frame)), IsOk());
    }
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    for (const TrackUpdate& update : listener.updates()) {
      std::vector<int64_t> expected, told;
      const PointRun& run = update.runs.at(0);
      for (size_t i = 0; i < run.x.size(); ++i) {
        if (run.first_frame + static_cast<int64_t>(i) != 3)
          expected.push_back(run.first_frame + static_cast<int64_t>(i));
      }
      for (const FrameTime& time : update.capture_times) {
        told.push_back(time.frame);
        EXPECT_EQ(time.capture_time, absl::FromUnixMillis(1000 + 33 * time.frame));
      }
      EXPECT_EQ(told, expected);
    }
  }
}

TEST_F(MotionTest, MemoryStaysWithinWhatWasAdmitted) {
  const int64_t frames = 24 + 8 + options_.max_pending_frames;
  const int64_t pictures = frames + 8 + options_.max_pending_frames + 2;
  options_.cache_budget_bytes = frames * FakeTrackerModel::kFrameBytes + pictures * FlowPyramid::MostBytes(kPicture) +
                                options_.limits.max_points * FlowPatch::kBytes;
  SessionConfig config = LiveConfig({kPoint, {8, 80, 50}});
  EXPECT_THAT(Track(config, 400), SizeIs(400));
  EXPECT_LE(metrics_.totals().max_cache_bytes, options_.cache_budget_bytes);
  EXPECT_GT(metrics_.totals().max_cache_bytes, 24 * (FakeTrackerModel::kFrameBytes + FlowPyramid::BytesOf(kPicture)));
}

TEST_F(MotionTest, RefusesASessionWhosePicturesDoNotFit) {
  options_.cache_budget_bytes = 60 * FakeTrackerModel::kFrameBytes;  // features alone would
  RecordingListener listener;
  SessionConfig config = PictureConfig({kPoint});
  EXPECT_THAT(engine().OpenSession(config, listener), StatusIs(absl::StatusCode::kResourceExhausted));
  config.motion_prior = config.polish = false;
  EXPECT_THAT(engine().OpenSession(config, listener), IsOk());
}

TEST_F(MotionTest, TellsTheMetricsOfTheStage) {
  Track(PictureConfig({kPoint}), 40);
  EXPECT_GT(metrics_.totals().stages[Stage::kFlow], 30);
}

TEST_F(MotionTest, ASessionMayBeDestroyedAtAnyMoment) {
  for (int64_t frames = 0; frames < 60; ++frames) {
    SessionConfig config = PictureConfig(Crowd(10));
    config.emit = frames % 3 == 0 ? Emit::kWindows : Emit::kEveryFrame;
    RecordingListener listener;
    auto session = Open(config, listener);
    for (int64_t i = 0; i < frames; ++i) ASSERT_THAT(listener.Push(*session, PictureFrame(i)), IsOk());
    if (frames % 2 == 0) session->Finish();
    session.reset();
    EXPECT_TRUE(listener.done());
  }
  EXPECT_EQ(counts_->alive, 0);
}

TEST_F(MotionTest, PublishedChainingHasNone) {
  options_.chaining = Chaining::kPublished;
  EXPECT_FALSE(engine().info().default_motion_prior);
  EXPECT_FALSE(engine().info().default_polish);
  RecordingListener listener;
  SessionConfig config = PictureConfig({kPoint}, 23);
  {
    auto session = Open(config, listener);
    EXPECT_FALSE(session->accepted().motion_prior);
    EXPECT_FALSE(session->accepted().polish);
  }
  RecordingListener refused;
  config.motion_prior = true;
  EXPECT_THAT(engine().OpenSession(config, refused),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("config.motion_prior")));
}

TEST_F(MotionTest, EveryFrameExcludesFinalOnly) {
  RecordingListener listener;
  SessionConfig config = LiveConfig({kPoint});
  config.send_provisional = false;
  EXPECT_THAT(engine().OpenSession(config, listener),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("config.emit")));
}

}  // namespace
}  // namespace holdfast
