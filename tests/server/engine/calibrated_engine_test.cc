// SPDX-License-Identifier: Apache-2.0
// How sessions judge their estimates when the network comes with a calibration, and who hears of the evidence.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/engine/tracks/calibration.h"
#include "server/engine/tracks/confidence.h"
#include "tests/server/engine/engine_fixture.h"
#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr PointQuery kWatched{7, 40.5f, 50.25f};

SessionConfig PolishedConfig() {
  SessionConfig config = Config({kWatched, {8, 70, 30}});
  config.raw_size = config.processing_size = kPicture;
  config.polish = true;
  return config;
}

// A picture that moves by 3/4 of a pixel a frame and, from frame 30 on, becomes another one slowly.
Frame CoveredFrame(int64_t index) {
  const float shift = 0.75f * static_cast<float>(index);
  GrayImage image = ShiftedTexture(kPicture, shift, 0);
  if (index >= 30) Cover(image, 0, static_cast<int>(index - 30) * 4, /*seed=*/9);
  return {index, BytesOf(image)};
}

// The evidence for each estimate, and how often it was told. Thread-safe.
class Told {
 public:
  using Key = std::pair<PointId, int64_t>;

  EvidenceSink Sink() {
    return [this](PointId id, int64_t frame, const Evidence& evidence) {
      absl::MutexLock lock(&mutex_);
      EXPECT_TRUE(evidence_.insert({{id, frame}, evidence}).second) << "point " << id << ", frame " << frame;
    };
  }
  std::map<Key, Evidence> evidence() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return evidence_;
  }
  std::set<int64_t> FramesOf(PointId id) const {
    std::set<int64_t> frames;
    for (const auto& [key, evidence] : evidence()) {
      if (key.first == id) frames.insert(key.second);
    }
    return frames;
  }

 private:
  mutable absl::Mutex mutex_;
  std::map<Key, Evidence> evidence_ ABSL_GUARDED_BY(mutex_);
};

std::set<int64_t> FramesFrom(int64_t first, int64_t last) {
  std::set<int64_t> frames;
  for (int64_t frame = first; frame <= last; ++frame) frames.insert(frame);
  return frames;
}

class CalibratedEngineTest : public EngineTest {
 protected:
  // A session as fast as there is room for frames, or each hop of frames only once the one before it is final.
  FinalTrack Track(const SessionConfig& config, int64_t frames, bool slowly = false) {
    RecordingListener listener;
    auto session = Open(config, listener);
    for (int64_t i = 0; i < frames; ++i) {
      EXPECT_THAT(listener.Push(*session, CoveredFrame(i)), IsOk());
      if (slowly && i % 8 == 7) listener.AwaitFinal(kWatched.id, i < 23 ? 1 : static_cast<size_t>(i - 14));
    }
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    return listener.Final(kWatched.id);
  }
};

TEST_F(CalibratedEngineTest, TheModelsCalibrationJudgesEveryEstimate) {
  model_->SetCalibration(Calibration({-std::log(19.0)}).ToJson());
  RecordingListener listener;
  auto session = Open(Config({{7, 10, 20}}), listener);
  PushFrames(*session, listener, 0, 40);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  for (const TrackUpdate& update : listener.updates()) {
    for (const PointRun& run : update.runs) {
      for (size_t i = 0; i < run.confidence.size(); ++i) {
        const bool queried = run.first_frame + static_cast<int64_t>(i) == 0;
        EXPECT_FLOAT_EQ(run.confidence[i], queried ? 1 : 0.05f);
        EXPECT_EQ(run.visible[i], queried ? 1 : 0);
      }
    }
  }
  EXPECT_THAT(listener.Final(7), SizeIs(40));
}

TEST_F(CalibratedEngineTest, WithoutACalibrationTheNetworksWordStands) {
  model_->similarity = 0.7f;
  RecordingListener listener;
  auto session = Open(Config({{7, 10, 20}}), listener);
  PushFrames(*session, listener, 0, 30);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  for (const auto& [frame, sample] : listener.Final(7)) EXPECT_NEAR(sample.confidence, frame == 0 ? 1 : 0.75f, 0.002f);
}

TEST(BadCalibrationTest, IsRefusedWithTheEngine) {
  SimulatedClock clock;
  RecordingMetrics metrics;
  const std::pair<const char*, const char*> cases[] = {
      {"certain", "syntax error"}, {"{}", "version 1"}, {R"({"version": 1, "weights": {}})", "no weight constant"}};
  for (const auto& [json, message] : cases) {
    auto model = std::make_unique<FakeTrackerModel>();
    model->SetCalibration(json);
    EXPECT_THAT(CreateEngineWithModel({}, std::move(model), clock, metrics),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("calibration of confidence"), HasSubstr(message))));
  }
}

TEST_F(CalibratedEngineTest, TheSinkHearsOfEveryFinalEstimateButNotOfQueries) {
  Told told;
  options_.evidence = told.Sink();
  model_->similarity = 0.7f;
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
  PushFrames(*session, listener, 0, 24);
  listener.AwaitFinal(2, 9);
  EXPECT_EQ(told.FramesOf(2), FramesFrom(1, 8)) << "before they are reported";
  PushFrames(*session, listener, 24, 25);
  ASSERT_THAT(session->RemovePoints({1}), IsOk());
  ASSERT_THAT(listener.Push(*session, MakeFrame(25, {{3, 30, 5}})), IsOk());
  PushFrames(*session, listener, 26, 60);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(told.FramesOf(1), FramesFrom(1, 24));
  EXPECT_EQ(told.FramesOf(2), FramesFrom(1, 59));
  EXPECT_EQ(told.FramesOf(3), FramesFrom(26, 59));
  EXPECT_THAT(told.evidence(), SizeIs(24 + 59 + 34));
  for (const auto& [key, evidence] : told.evidence()) {
    EXPECT_EQ(evidence.similarity, Coarse(0.7f));
    EXPECT_EQ(evidence.age, key.second - (key.first == 3 ? 25 : 0));
    EXPECT_EQ(listener.Final(key.first).at(key.second).confidence, NetworkConfidence(evidence));
  }
}

TEST_F(CalibratedEngineTest, TheSinkHearsWhatPolishFound) {
  Told told;
  options_.evidence = told.Sink();
  model_->keep_starts = true;
  model_->step = 0.03f;
  const Calibration calibration({-0.5, 0.25, 0.125, 0.5, -0.25, -0.125, 1, 0.5, -1});
  model_->SetCalibration(calibration.ToJson());
  const FinalTrack track = Track(PolishedConfig(), 60);
  ASSERT_THAT(track, SizeIs(60));
  std::map<Evidence::Polish, int> outcomes;
  for (const auto& [key, evidence] : told.evidence()) {
    if (key.first != kWatched.id) continue;
    ++outcomes[evidence.polish];
    EXPECT_EQ(track.at(key.second).confidence, calibration.Confidence(evidence)) << "frame " << key.second;
  }
  EXPECT_EQ(told.FramesOf(kWatched.id), FramesFrom(1, 59));
  EXPECT_GE(outcomes[Evidence::Polish::kFromQuery], 29) << "as long as the picture only moves";
  EXPECT_GE(outcomes[Evidence::Polish::kNotFound], 1) << "once it is another one";
  EXPECT_EQ(outcomes[Evidence::Polish::kNotTried], 0);
}

TEST_F(CalibratedEngineTest, FinalConfidencesDoNotDependOnThePace) {
  model_->keep_starts = true;
  model_->step = 0.03f;
  model_->SetCalibration(Calibration({-0.5, 0.25, 0.125, 0.5, -0.25, -0.125, 1, 0.5, -1}).ToJson());
  const FinalTrack fast = Track(PolishedConfig(), 60), slow = Track(PolishedConfig(), 60, /*slowly=*/true);
  ASSERT_THAT(fast, SizeIs(60));
  EXPECT_EQ(fast, slow);
  SessionConfig live = PolishedConfig();
  live.emit = Emit::kEveryFrame;
  EXPECT_EQ(Track(live, 60), fast);
  EXPECT_EQ(Track(live, 60, /*slowly=*/true), fast);
  std::set<float> values;
  for (const auto& [frame, sample] : fast) values.insert(sample.confidence);
  EXPECT_GT(values.size(), 20u) << "a track that shows nothing proves nothing";
}

}  // namespace
}  // namespace holdfast
