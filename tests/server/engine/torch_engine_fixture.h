// SPDX-License-Identifier: Apache-2.0
// Engines over the real network, and videos of tensors tracked through them.
#pragma once

#include <gtest/gtest.h>
#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "api/clock.h"
#include "server/engine/engine_with_model.h"
#include "server/engine/local_tracker.h"
#include "server/engine/torch_tracker_model.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {

inline std::unique_ptr<Engine> EngineOf(PointModel model, const EngineOptions& options) {
  static SimulatedClock clock;  // stands still
  static NullEngineMetrics metrics;
  // By a clock that stands still a large network never takes long enough to be warmed up by two runs.
  auto network = MakeTorchTrackerModel({std::move(model), "test", "00"}, options, SystemClock(), metrics);
  EXPECT_THAT(network, IsOk());
  auto engine = CreateEngineWithModel(options, *std::move(network), clock, metrics);
  EXPECT_THAT(engine, IsOk());
  return *std::move(engine);
}

// The network alone, with every iteration.
inline EngineOptions Exact(ImageSize processing) {
  EngineOptions options;
  options.motion_prior = options.polish = false;
  options.least_step = 0;
  options.precision = Precision::kFloat32;
  options.compute_threads = 1;
  options.processing_size = processing;
  return options;
}

// frames [T, H, W, 3] uint8.
inline Frame FrameOf(const torch::Tensor& frames, int64_t index) {
  const torch::Tensor frame = frames[index].contiguous();
  return {index, std::string(static_cast<const char*>(frame.data_ptr()), frame.numel())};
}

inline SessionConfig RawConfig(const torch::Tensor& frames) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  config.raw_size = {static_cast<int>(frames.size(2)), static_cast<int>(frames.size(1))};
  return config;
}

inline void Track(Engine& engine, const SessionConfig& config, const torch::Tensor& frames,
                  RecordingObserver& observer) {
  LocalTracker tracker(engine);
  auto stream = tracker.Open(config, observer);
  ASSERT_THAT(stream, IsOk());
  for (int64_t i = 0; i < frames.size(0); ++i) ASSERT_THAT((*stream)->PushFrame(FrameOf(frames, i)), IsOk());
  ASSERT_THAT((*stream)->Finish(), IsOk());
}

}  // namespace holdfast
