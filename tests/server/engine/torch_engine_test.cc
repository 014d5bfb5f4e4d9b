// SPDX-License-Identifier: Apache-2.0
// The engine over the real network: golden numbers through LocalTracker, and the independence of points to the bit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "model/checkpoint/metadata.h"
#include "server/engine/engine_with_model.h"
#include "server/engine/local_tracker.h"
#include "server/engine/torch_tracker_model.h"
#include "server/engine/tracks/calibration.h"
#include "tests/support/golden.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/networks.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

std::unique_ptr<Engine> EngineOf(PointModel model, const EngineOptions& options) {
  static SimulatedClock clock;  // stands still
  static NullEngineMetrics metrics;
  auto network = MakeTorchTrackerModel({std::move(model), "test", "00"}, options, clock, metrics);
  EXPECT_THAT(network, IsOk());
  auto engine = CreateEngineWithModel(options, *std::move(network), clock, metrics);
  EXPECT_THAT(engine, IsOk());
  return *std::move(engine);
}

// The network alone.
EngineOptions Exact(ImageSize processing) {
  EngineOptions options;
  options.motion_prior = options.polish = false;
  options.precision = Precision::kFloat32;
  options.compute_threads = 1;
  options.processing_size = processing;
  return options;
}

// frames [T, H, W, 3] uint8.
Frame FrameOf(const torch::Tensor& frames, int64_t index) {
  const torch::Tensor frame = frames[index].contiguous();
  return {index, std::string(static_cast<const char*>(frame.data_ptr()), frame.numel())};
}

SessionConfig RawConfig(const torch::Tensor& frames) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  config.raw_size = {static_cast<int>(frames.size(2)), static_cast<int>(frames.size(1))};
  return config;
}

std::vector<PointQuery> Queries(const torch::Tensor& xy) {
  std::vector<PointQuery> queries;
  for (int64_t n = 0; n < xy.size(0); ++n) {
    queries.push_back({static_cast<PointId>(n), xy[n][0].item<float>(), xy[n][1].item<float>()});
  }
  return queries;
}

void Track(Engine& engine, const SessionConfig& config, const torch::Tensor& frames, RecordingObserver& observer) {
  LocalTracker tracker(engine);
  auto stream = tracker.Open(config, observer);
  ASSERT_THAT(stream, IsOk());
  for (int64_t i = 0; i < frames.size(0); ++i) ASSERT_THAT((*stream)->PushFrame(FrameOf(frames, i)), IsOk());
  ASSERT_THAT((*stream)->Finish(), IsOk());
}

// [T, N, 2] float32
torch::Tensor Finals(const RecordingObserver& observer, int64_t frames, int64_t points) {
  torch::Tensor xy = torch::full({frames, points, 2}, NAN);
  for (int64_t n = 0; n < points; ++n) {
    for (const auto& [frame, sample] : observer.Final(static_cast<PointId>(n))) {
      xy[frame][n][0] = sample.x;
      xy[frame][n][1] = sample.y;
    }
  }
  return xy;
}

torch::Tensor RunGolden(Chaining chaining, const TensorMap& golden, int iterations, int64_t frames) {
  EngineOptions options = Exact({160, 128});
  options.chaining = chaining;
  auto engine = EngineOf(FormulaModel(PublishedOptions()), options);
  SessionConfig config = RawConfig(golden.at("frames"));
  config.hop_frames = 23;
  config.iterations = iterations;
  config.send_provisional = false;
  config.points = Queries(golden.at("queries_xy"));
  RecordingObserver observer;
  Track(*engine, config, golden.at("frames").narrow(0, 0, frames), observer);
  return Finals(observer, frames, 8);
}

TEST(TorchEngineTest, ChainsWindowsAsThePublishedScriptDoes) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor tracks = RunGolden(Chaining::kPublished, golden, 4, 47);
  const Difference difference = Measure("chained_47_iters4", tracks, golden.at("chained_47_iters4"));
  EXPECT_LE(difference.max, 1.0);
  EXPECT_LE(difference.mean, 0.05);
}

TEST(TorchEngineTest, OneWindowEqualsThePublishedRun) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor tracks = RunGolden(Chaining::kStandard, golden, 1, 24);
  EXPECT_LE(Measure("coords_iter0", tracks, golden.at("coords_iter0")).max, 1e-3);
}

TEST(TorchEngineTest, TheFirstWindowOfHop23IsThatOfThePublishedChaining) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor own = RunGolden(Chaining::kStandard, golden, 2, 47);
  const torch::Tensor published = RunGolden(Chaining::kPublished, golden, 2, 47);
  EXPECT_TRUE(own.narrow(0, 0, 24).equal(published.narrow(0, 0, 24)));
  EXPECT_FALSE(own.equal(published)) << "the second window starts from other templates";
}

TEST(TorchEngineTest, RunsTheShippedWeights) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors"),
                  expected = ReadGolden("interim_expected.safetensors");
  EngineOptions options = Exact({160, 128});
  options.weights_path = std::string(HOLDFAST_SOURCE_DIR) + "/tests/data/interim.safetensors";
  SimulatedClock clock;
  NullEngineMetrics metrics;
  const torch::Tensor frames = golden.at("frames").narrow(0, 0, 24);
  torch::Tensor tracks[2];
  for (const Precision precision : {Precision::kFloat32, Precision::kBFloat16}) {
    options.precision = precision;
    auto engine = Engine::Create(options, clock, metrics);
    ASSERT_THAT(engine, IsOk());
    EXPECT_EQ((*engine)->info().weights_sha256.size(), 64u);
    SessionConfig config = RawConfig(frames);
    config.points = Queries(golden.at("queries_xy"));
    RecordingObserver observer;
    Track(**engine, config, frames, observer);
    tracks[precision == Precision::kBFloat16] = Finals(observer, 24, 8);
  }
  EXPECT_LE(Measure("coords_iter3", tracks[0], expected.at("coords_iter3")).max, 1e-2);
  EXPECT_LE(Measure("bfloat16", tracks[1], tracks[0]).mean, 0.5);
}

// Random frames that differ, small enough for milliseconds.
torch::Tensor RandomFrames(int64_t count, int64_t height = 64, int64_t width = 96) {
  torch::manual_seed(3);
  const torch::Tensor coarse = torch::rand({count, 3, height / 8, width / 8}) * 255;
  const std::vector<int64_t> size = {height, width};
  const torch::Tensor frames = torch::upsample_bilinear2d(coarse, size, /*align_corners=*/false);
  return frames.permute({0, 2, 3, 1}).to(torch::kUInt8).contiguous();
}

TEST(TorchEngineTest, APointIsTheSameToTheBitAloneInACrowdAndAddedLate) {
  auto engine = EngineOf(RandomModel(), Exact({96, 64}));
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
  const SimulatedClock clock;
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
  const SimulatedClock clock;
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
  const SimulatedClock clock;
  NullEngineMetrics metrics;
  EXPECT_THAT(MakeTorchTrackerModel({RandomModel(), "test", "00"}, options, clock, metrics),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(TorchTrackerModelTest, HasTheCalibrationOfItsCheckpoint) {
  const SimulatedClock clock;
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
  ASSERT_THAT(CopyWithMetadata(HOLDFAST_SOURCE_DIR "/tests/data/interim.safetensors", options.weights_path,
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
