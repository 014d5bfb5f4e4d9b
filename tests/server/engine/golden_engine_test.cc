// SPDX-License-Identifier: Apache-2.0
// Numbers of the published code, and the shipped weights, through the whole engine.
#include <gtest/gtest.h>
#include <torch/types.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/server/engine/torch_engine_fixture.h"
#include "tests/support/bfloat16_convolutions.h"
#include "tests/support/golden.h"
#include "tests/support/networks.h"
#include "tests/support/source_tree.h"

namespace holdfast {
namespace {

std::vector<PointQuery> Queries(const torch::Tensor& xy) {
  std::vector<PointQuery> queries;
  for (int64_t n = 0; n < xy.size(0); ++n) {
    queries.push_back({static_cast<PointId>(n), xy[n][0].item<float>(), xy[n][1].item<float>()});
  }
  return queries;
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

TEST(GoldenEngineTest, ChainsWindowsAsThePublishedScriptDoes) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor tracks = RunGolden(Chaining::kPublished, golden, 4, 47);
  const Difference difference = Measure("chained_47_iters4", tracks, golden.at("chained_47_iters4"));
  EXPECT_LE(difference.max, 1.0);
  EXPECT_LE(difference.mean, 0.05);
}

TEST(GoldenEngineTest, OneWindowEqualsThePublishedRun) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor tracks = RunGolden(Chaining::kStandard, golden, 1, 24);
  EXPECT_LE(Measure("coords_iter0", tracks, golden.at("coords_iter0")).max, 1e-3);
}

TEST(GoldenEngineTest, TheFirstWindowOfHop23IsThatOfThePublishedChaining) {
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor own = RunGolden(Chaining::kStandard, golden, 2, 47);
  const torch::Tensor published = RunGolden(Chaining::kPublished, golden, 2, 47);
  EXPECT_TRUE(own.narrow(0, 0, 24).equal(published.narrow(0, 0, 24)));
  EXPECT_FALSE(own.equal(published)) << "the second window starts from other templates";
}

// The golden clip's first 24 frames and 8 queries, with weights from a file.
torch::Tensor RunWeights(const TensorMap& golden, Precision precision) {
  EngineOptions options = Exact({160, 128});
  options.weights_path = InSourceTree("tests/data/interim.safetensors");
  options.precision = precision;
  SystemClock clock;
  NullEngineMetrics metrics;
  auto engine = Engine::Create(options, clock, metrics);
  EXPECT_THAT(engine, IsOk());
  if (!engine.ok()) return torch::full({24, 8, 2}, NAN);
  EXPECT_EQ((*engine)->info().weights_sha256.size(), 64u);
  const torch::Tensor frames = golden.at("frames").narrow(0, 0, 24);
  SessionConfig config = RawConfig(frames);
  config.points = Queries(golden.at("queries_xy"));
  RecordingObserver observer;
  Track(**engine, config, frames, observer);
  return Finals(observer, 24, 8);
}

TEST(GoldenEngineTest, RunsTheShippedWeights) {
  const torch::Tensor tracks = RunWeights(ReadGolden("pips2_golden.safetensors"), Precision::kFloat32);
  const TensorMap expected = ReadGolden("interim_expected.safetensors");
  EXPECT_LE(Measure("coords_iter3", tracks, expected.at("coords_iter3")).max, 1e-2);
}

TEST(GoldenEngineTest, RunsTheShippedWeightsInBFloat16) {
  SKIP_WITHOUT_BFLOAT16_CONVOLUTIONS();
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  const torch::Tensor tracks = RunWeights(golden, Precision::kBFloat16);
  EXPECT_LE(Measure("bfloat16", tracks, RunWeights(golden, Precision::kFloat32)).mean, 0.5);
}

}  // namespace
}  // namespace holdfast
