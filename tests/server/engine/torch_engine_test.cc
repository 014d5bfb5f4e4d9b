// SPDX-License-Identifier: Apache-2.0
// The engine over the real network: the independence of points to the bit, precisions, and weights that are no good.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "api/clock.h"
#include "model/checkpoint/metadata.h"
#include "server/engine/local_tracker.h"
#include "server/engine/torch_tracker_model.h"
#include "server/engine/tracks/calibration.h"
#include "tests/server/engine/torch_engine_fixture.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/networks.h"
#include "tests/support/recorders.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

// Random frames that differ, small enough for milliseconds.
torch::Tensor RandomFrames(int64_t count, int64_t height = 64, int64_t width = 96) {
  torch::manual_seed(3);
  const torch::Tensor coarse = torch::rand({count, 3, height / 8, width / 8}) * 255;
  const std::vector<int64_t> size = {height, width};
  const torch::Tensor frames = torch::upsample_bilinear2d(coarse, size, /*align_corners=*/false);
  return frames.permute({0, 2, 3, 1}).to(torch::kUInt8).contiguous();
}

// At this least step some rows of the random network end early and some do not.
constexpr double kSomeRowsEnd = 6;

TEST(TorchEngineTest, APointIsTheSameToTheBitAloneInACrowdAndAddedLate) {
  EngineOptions options = Exact({96, 64});
  options.least_step = kSomeRowsEnd;
  auto engine = EngineOf(RandomModel(), options);
  LocalTracker tracker(*engine);
  const torch::Tensor frames = RandomFrames(50);
  const PointQuery query{1000, 40.5f, 30.25f};
  SessionConfig config = RawConfig(frames);
  RecordingObserver alone, crowd, other;
  auto a = *tracker.Open(config, alone);
  for (PointId id = 0; id < 60; ++id) config.points.push_back({id, 1.5f * static_cast<float>(id), 20.0f});
  auto b = *tracker.Open(config, crowd);
  config.processing_size = {160, 128};  // a session of another size in the same batches
  auto c = *tracker.Open(config, other);
  for (int64_t i = 0; i < 50; ++i) {
    Frame frame = FrameOf(frames, i);
    if (i == 5) frame.points = {query};
    ASSERT_THAT(a->PushFrame(frame), IsOk());
    ASSERT_THAT(b->PushFrame(FrameOf(frames, i)), IsOk());
    ASSERT_THAT(c->PushFrame(FrameOf(frames, i)), IsOk());
    if (i == 5) {
      ASSERT_THAT(b->AddPoints({query}), IsOk());
    }
    if (i == 20) {
      ASSERT_THAT(b->RemovePoints({3, 4, 5}), IsOk());
    }
  }
  EXPECT_THAT(a->Finish(), IsOk());
  EXPECT_THAT(b->Finish(), IsOk());
  EXPECT_THAT(c->Finish(), IsOk());
  EXPECT_THAT(alone.Final(1000), SizeIs(45));
  EXPECT_EQ(alone.Final(1000), crowd.Final(1000));
  EXPECT_THAT(other.Final(59), SizeIs(50));
}

TEST(TorchEngineTest, TracksAreTheSameToTheBitWhateverTheThreadsAndTheBatches) {
  const torch::Tensor frames = RandomFrames(30);
  SessionConfig config = RawConfig(frames);
  for (PointId id = 0; id < 40; ++id) {
    config.points.push_back({id, 2.25f * static_cast<float>(id), 1.5f * static_cast<float>(id)});
  }
  const auto track = [&](int threads, int batch_frames, int batch_rows, RecordingObserver& observer) {
    EngineOptions options = Exact({96, 64});
    options.compute_threads = threads;
    options.max_batch_frames = batch_frames;
    options.max_batch_rows = batch_rows;
    Track(*EngineOf(RandomModel(), options), config, frames, observer);
  };
  RecordingObserver want;
  track(1, 1, 7, want);
  for (const int threads : {1, 2, 3}) {
    for (const auto& [batch_frames, batch_rows] : {std::pair(1, 20), std::pair(5, 256)}) {
      RecordingObserver got;
      track(threads, batch_frames, batch_rows, got);
      for (const PointQuery& point : config.points) {
        EXPECT_THAT(got.Final(point.id), SizeIs(30));
        EXPECT_TRUE(got.Final(point.id) == want.Final(point.id)) << point.id << " on " << threads << " threads";
      }
    }
  }
}

// Of the rows of a session with these options, their mean.
double IterationsOf(const EngineOptions& options) {
  SystemClock clock;
  RecordingMetrics metrics;
  auto model = MakeTorchTrackerModel({RandomModel(), "test", "00"}, options, clock, metrics);
  EXPECT_THAT(model, IsOk());
  auto engine = CreateEngineWithModel(options, *std::move(model), clock, metrics);
  EXPECT_THAT(engine, IsOk());
  const torch::Tensor frames = RandomFrames(40);
  SessionConfig config = RawConfig(frames);
  for (PointId id = 0; id < 20; ++id) config.points.push_back({id, 4.5f * static_cast<float>(id), 30.0f});
  RecordingObserver observer;
  Track(**engine, config, frames, observer);
  return static_cast<double>(metrics.totals().iterations) / static_cast<double>(metrics.totals().rows);
}

TEST(TorchEngineTest, RowsThatStandStillEndEarlyAndTellTheMetrics) {
  EngineOptions options = Exact({96, 64});
  EXPECT_EQ(IterationsOf(options), 4);
  options.least_step = 1e6;
  EXPECT_EQ(IterationsOf(options), 1);
  options.least_step = kSomeRowsEnd;
  EXPECT_GT(IterationsOf(options), 1.1);
  EXPECT_LT(IterationsOf(options), 3.9);
  options.least_step = 1e6;
  options.chaining = Chaining::kPublished;
  options.hop_frames = 23;
  EXPECT_EQ(IterationsOf(options), 4) << "the templates of the last iteration are carried over";
}

TEST(TorchEngineTest, ProvisionalResultsChangeNoFinalOne) {
  auto engine = EngineOf(RandomModel(), Exact({96, 64}));
  const torch::Tensor frames = RandomFrames(45);
  SessionConfig config = RawConfig(frames);
  config.points = {{1, 50, 30}};
  RecordingObserver with, without;
  Track(*engine, config, frames, with);
  config.send_provisional = false;
  Track(*engine, config, frames, without);
  EXPECT_THAT(with.Final(1), SizeIs(45));
  EXPECT_EQ(with.Final(1), without.Final(1));
}

TEST(TorchEngineTest, AResumedSessionIsTheSameToTheBit) {
  const MemorySealer sealer;
  EngineOptions options = Exact({96, 64});
  options.sealer = &sealer;
  options.motion_prior = options.polish = true;
  options.least_step = kSomeRowsEnd;
  auto engine = EngineOf(RandomModel(), options), other = EngineOf(RandomModel(), options);
  const torch::Tensor frames = RandomFrames(60);
  SessionConfig config = RawConfig(frames);
  config.points = {{1, 50, 30}, {2, 20.5f, 40.25f}, {3, 80, 10}};
  RecordingObserver whole, resumed;
  Track(*engine, config, frames, whole);

  RecordingListener first;
  auto session = *engine->OpenSession(config, first);
  for (int64_t i = 0; i < 41; ++i) ASSERT_THAT(first.Push(*session, FrameOf(frames, i)), IsOk());
  session->Suspend(absl::UnavailableError("going away"));
  EXPECT_THAT(first.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
  ASSERT_THAT(first.checkpoints(), SizeIs(1));

  config.resume_token = first.checkpoints()[0].token;
  LocalTracker tracker(*other);
  auto stream = tracker.Open(config, resumed);
  ASSERT_THAT(stream, IsOk());
  for (int64_t i = first.checkpoints()[0].next_frame; i < 60; ++i) {
    ASSERT_THAT((*stream)->PushFrame(FrameOf(frames, i)), IsOk());
  }
  ASSERT_THAT((*stream)->Finish(), IsOk());
  for (const PointId id : {1, 2, 3}) {
    FinalTrack track = first.Final(id);
    const FinalTrack rest = resumed.Final(id);
    track.insert(rest.begin(), rest.end());
    EXPECT_THAT(track, SizeIs(60));
    EXPECT_TRUE(track == whole.Final(id)) << "point " << id;
  }
}

TEST(TorchTrackerModelTest, KnowsTheBytesOfAFrameBeforehandAndFreesThemOneByOne) {
  const SystemClock clock;
  NullEngineMetrics metrics;
  for (const Precision precision : {Precision::kFloat32, Precision::kBFloat16}) {
    EngineOptions options = Exact({64, 64});
    options.precision = precision;
    auto model = *MakeTorchTrackerModel({RandomModel(), "test", "00"}, options, clock, metrics);
    for (const ImageSize size : {ImageSize{32, 32}, ImageSize{96, 64}, ImageSize{224, 160}}) {
      const RgbImage image{size, std::vector<uint8_t>(size_t{3} * size.width * size.height)};
      const RgbImage* images[] = {&image, &image, &image};
      for (const FrameFeaturesPtr& features : model->Encode(images)) {
        EXPECT_EQ(features->bytes(), model->FrameBytes(size));
      }
    }
  }
}

TEST(TorchTrackerModelTest, TracksAtTheSmallestSize) {
  auto engine = EngineOf(RandomModel(), Exact({32, 32}));
  const torch::Tensor frames = RandomFrames(30, 32, 32);
  SessionConfig config = RawConfig(frames);
  config.points = {{1, 31, 31}};
  RecordingObserver observer;
  Track(*engine, config, frames, observer);
  EXPECT_THAT(observer.Final(1), SizeIs(30));
}

// oneDNN chooses its instructions once a process: the question is asked in a process of its own, which must not return.
[[noreturn]] void ExitWithFloat32Chosen(const char* instruction_set) {
  setenv("ONEDNN_MAX_CPU_ISA", instruction_set, 1);
  EngineOptions options = Exact({64, 64});
  options.precision = Precision::kAuto;
  const SystemClock clock;
  NullEngineMetrics metrics;
  const auto model = MakeTorchTrackerModel({RandomModel(), "test", "00"}, options, clock, metrics);
  std::_Exit(model.ok() && (*model)->info().precision == "float32" ? 10 : 11);
}

TEST(TorchTrackerModelDeathTest, ChoosesFloat32WhereOneDnnMayNotUseTheProcessorsBFloat16) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(ExitWithFloat32Chosen("AVX512_CORE"), testing::ExitedWithCode(10), "");
  EXPECT_EXIT(ExitWithFloat32Chosen("AVX2"), testing::ExitedWithCode(10), "");
}

TEST(TorchTrackerModelTest, KnowsWhatTheNetworkCosts) {
  const SystemClock clock;
  NullEngineMetrics metrics;
  const WorkCosts costs =
      (*MakeTorchTrackerModel({RandomModel(), "test", "00"}, Exact({64, 64}), clock, metrics))->info().costs;
  EXPECT_GT(costs.pixel, 0);
  EXPECT_GT(costs.row, 0);
  EXPECT_GE(costs.batch, 0);
}

TEST(TorchTrackerModelTest, RefusesADeviceThatIsNotThere) {
  EngineOptions options = Exact({64, 64});
  options.device = "abacus";
  const SystemClock clock;
  NullEngineMetrics metrics;
  EXPECT_THAT(MakeTorchTrackerModel({RandomModel(), "test", "00"}, options, clock, metrics),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(TorchTrackerModelTest, HasTheCalibrationOfItsCheckpoint) {
  const SystemClock clock;
  NullEngineMetrics metrics;
  LoadedModel calibrated{RandomModel(), "test", "00", {{Calibration::kMetadataKey, "as it was"}, {"note", "x"}}};
  EXPECT_EQ((*MakeTorchTrackerModel(std::move(calibrated), Exact({64, 64}), clock, metrics))->info().calibration,
            "as it was");
  EXPECT_EQ(
      (*MakeTorchTrackerModel({RandomModel(), "test", "00"}, Exact({64, 64}), clock, metrics))->info().calibration, "");
}

TEST(EngineTest, RefusesWeightsWithABadCalibration) {
  const TempDir dir;
  EngineOptions options = Exact({64, 64});
  options.weights_path = dir.File("m.safetensors");
  ASSERT_THAT(CopyWithMetadata(InSourceTree("tests/data/interim.safetensors"), options.weights_path,
                               Calibration::kMetadataKey, "{}"),
              IsOk());
  SystemClock clock;
  NullEngineMetrics metrics;
  EXPECT_THAT(Engine::Create(options, clock, metrics),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("calibration of confidence")));
}

TEST(EngineTest, SaysWhenThereAreNoWeights) {
  EngineOptions options;
  options.weights_path = "/nowhere/weights.safetensors";
  SystemClock clock;
  NullEngineMetrics metrics;
  EXPECT_THAT(Engine::Create(options, clock, metrics), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace holdfast
