// SPDX-License-Identifier: Apache-2.0
// The engine with its threads, over a network whose answers are known.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/engine/engine.h"
#include "server/engine/engine_with_model.h"
#include "tests/support/fake_tracker_model.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {

// Holds back who passes until it is opened.
class Gate {
 public:
  void Pass() {
    absl::MutexLock lock(&mutex_);
    ++waiting_;
    changed_.SignalAll();
    while (!open_) changed_.Wait(&mutex_);
  }
  void AwaitWaiting() {
    absl::MutexLock lock(&mutex_);
    while (waiting_ == 0) changed_.Wait(&mutex_);
  }
  void Open() {
    absl::MutexLock lock(&mutex_);
    open_ = true;
    changed_.SignalAll();
  }

 private:
  absl::Mutex mutex_;
  absl::CondVar changed_;
  bool open_ ABSL_GUARDED_BY(mutex_) = false;
  int waiting_ ABSL_GUARDED_BY(mutex_) = 0;
};

constexpr ImageSize kFrame{64, 32};

inline SessionConfig Config(std::vector<PointQuery> points = {}, int hop = 8) {
  SessionConfig config;
  config.encoding = FrameEncoding::kGray8;
  config.raw_size = kFrame;
  config.processing_size = kFrame;
  config.hop_frames = hop;
  config.points = std::move(points);
  return config;
}

inline Frame MakeFrame(int64_t index, std::vector<PointQuery> points = {}) {
  return {index, std::string(kFrame.width * kFrame.height, static_cast<char>(index % 251)), {}, std::move(points)};
}

class EngineTest : public ::testing::Test {
 protected:
  EngineTest() : model_(new FakeTrackerModel), counts_(model_->counts()) { options_.decode_threads = 2; }

  // Before it: options_ and *model_ may be changed.
  Engine& engine() {
    if (!engine_) {
      auto engine = CreateEngineWithModel(options_, std::unique_ptr<TrackerModel>(model_), clock_, metrics_);
      EXPECT_THAT(engine, IsOk());
      engine_ = *std::move(engine);
    }
    return *engine_;
  }
  std::unique_ptr<EngineSession> Open(const SessionConfig& config, RecordingListener& listener) {
    auto session = engine().OpenSession(config, listener);
    EXPECT_THAT(session, IsOk());
    return *std::move(session);
  }
  static void PushFrames(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) ASSERT_THAT(listener.Push(session, MakeFrame(i)), IsOk());
  }

  EngineOptions options_;
  SimulatedClock clock_;
  RecordingMetrics metrics_;
  FakeTrackerModel* model_;  // the engine's, once there is one
  std::shared_ptr<const FakeTrackerModel::Counts> counts_;
  std::unique_ptr<Engine> engine_;
};

}  // namespace holdfast
