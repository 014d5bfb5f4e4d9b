// SPDX-License-Identifier: Apache-2.0
// Speed of the network's parts and of whole windows. Run it alone on the machine:
//   build/release/bin/holdfast-model-benchmark [--benchmark_filter=Window] (HOLDFAST_BENCHMARK_THREADS: default 2)
#include <benchmark/benchmark.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdlib>

#include "model/ops/correlation.h"
#include "model/ops/instance_norm.h"
#include "model/ops/patch_attention.h"
#include "model/ops/sampling.h"
#include "model/point_model.h"
#include "model/presets.h"
#include "program/network_process.h"

namespace holdfast {
namespace {

constexpr int64_t kFrames = 24;

enum Precision : int64_t { kFloat = 0, kHalf = 1 };

torch::ScalarType TypeOf(int64_t precision) { return precision == kHalf ? torch::kBFloat16 : torch::kFloat32; }

PointModel MakeModel(const char* preset, int64_t precision) {
  torch::manual_seed(1);
  PointModel model(PresetByName(preset).value());
  model->to(TypeOf(precision));
  model->eval();
  return model;
}

torch::Tensor Pictures(int64_t frames, int64_t height, int64_t width) {
  return torch::randint(0, 256, {frames, height, width, 3}, torch::kUInt8);
}

WindowRows MakeRows(const torch::Tensor& maps, int64_t points, int64_t levels) {
  WindowRows rows;
  rows.frames = BuildPyramids(maps, levels);
  const torch::Tensor size = torch::tensor({maps.size(3) - 1, maps.size(2) - 1}, torch::kFloat32);
  const torch::Tensor xy = torch::rand({points, 2}) * size;
  rows.start = xy.unsqueeze(1).repeat({1, kFrames, 1});
  rows.feature = SampleFeatures(rows.frames.front(), xy);
  return rows;
}

// Arguments: precision, height, width.
void BM_Encode(benchmark::State& state, const char* preset) {
  const c10::InferenceMode guard;
  PointModel model = MakeModel(preset, state.range(0));
  const torch::Tensor picture = Pictures(1, state.range(1), state.range(2));
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(model->Encode(picture));
}
BENCHMARK_CAPTURE(BM_Encode, pips2, "pips2")->ArgsProduct({{kFloat, kHalf}, {384}, {512}})->UseRealTime();
BENCHMARK_CAPTURE(BM_Encode, paper, "paper")->ArgsProduct({{kFloat, kHalf}, {512}, {896}})->UseRealTime();
BENCHMARK_CAPTURE(BM_Encode, small, "small")->ArgsProduct({{kFloat, kHalf}, {384}, {512}})->UseRealTime();

// Arguments: precision, rows.
void BM_UpdateBlock(benchmark::State& state, const char* preset) {
  const c10::InferenceMode guard;
  const ModelOptions options = PresetByName(preset).value();
  UpdateBlock block(options);
  block->to(TypeOf(state.range(0)));
  const torch::Tensor correlation = torch::randn({state.range(1), kFrames, options.CorrelationFeatures()});
  const torch::Tensor xy = torch::rand({state.range(1), kFrames, 2}) * 40;
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(block->forward(correlation, xy));
  state.SetItemsProcessed(state.iterations() * state.range(1));
}
BENCHMARK_CAPTURE(BM_UpdateBlock, pips2, "pips2")->ArgsProduct({{kFloat, kHalf}, {1, 8, 64, 256}})->UseRealTime();
BENCHMARK_CAPTURE(BM_UpdateBlock, small, "small")->ArgsProduct({{kFloat, kHalf}, {256}})->UseRealTime();

// Arguments: precision, rows, templates.
void BM_Correlation(benchmark::State& state) {
  const c10::InferenceMode guard;
  const torch::Tensor maps = torch::randn({kFrames, 128, 64, 112}).to(TypeOf(state.range(0)));
  const PyramidCells window = BuildCells(maps, 4);
  FeatureViews views;
  views.Add(window, state.range(1));
  const torch::Tensor templates = torch::randn({state.range(1), kFrames, state.range(2), 128});
  const torch::Tensor xy = torch::rand({state.range(1), kFrames, 2}) * 60;
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(Correlate(views, templates, xy, 3));
}
BENCHMARK(BM_Correlation)->ArgsProduct({{kFloat, kHalf}, {256}, {1, 3}})->UseRealTime();

// Forward and backward, as training runs it. Argument: precision of the maps.
void BM_CorrelationGradient(benchmark::State& state) {
  const auto maps = torch::randn({kFrames, 64, 24, 32}).to(TypeOf(state.range(0))).requires_grad_();
  const torch::Tensor templates = torch::randn({64, kFrames, 3, 64}).requires_grad_();
  const torch::Tensor xy = torch::rand({64, kFrames, 2}) * 24;
  for ([[maybe_unused]] auto _ : state) Correlate(BuildCells(maps, 4), templates, xy, 3).sum().backward();
}
BENCHMARK(BM_CorrelationGradient)->Arg(kFloat)->Arg(kHalf)->UseRealTime();

// Arguments: precision, channels, height, width.
void BM_InstanceNorm(benchmark::State& state) {
  const c10::InferenceMode guard;
  const torch::Tensor x = torch::randn({1, state.range(1), state.range(2), state.range(3)})
                              .to(TypeOf(state.range(0)))
                              .contiguous(torch::MemoryFormat::ChannelsLast);
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(InstanceNormRelu(x));
}
BENCHMARK(BM_InstanceNorm)->ArgsProduct({{kFloat, kHalf}, {64}, {192}, {256}})->UseRealTime();

// Argument: precision.
void BM_PatchAttention(benchmark::State& state) {
  const c10::InferenceMode guard;
  const torch::Tensor query = torch::randn({1, 64, 112, 128}).to(TypeOf(state.range(0)));
  const torch::Tensor value = torch::randn({1, 64, 112, 128}).to(TypeOf(state.range(0)));
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(PatchAttention(query, value, {8, 7}));
}
BENCHMARK(BM_PatchAttention)->Arg(kFloat)->Arg(kHalf)->UseRealTime();

// 24 frames encoded and their points refined. Arguments: precision, height, width, points, iterations.
void BM_Window(benchmark::State& state, const char* preset) {
  const c10::InferenceMode guard;
  PointModel model = MakeModel(preset, state.range(0));
  const torch::Tensor pictures = Pictures(kFrames, state.range(1), state.range(2));
  for ([[maybe_unused]] auto _ : state) {
    const WindowRows rows = MakeRows(model->Encode(pictures), state.range(3), model->options().correlation_levels);
    benchmark::DoNotOptimize(model->Refine({rows}, {state.range(4), false}));
  }
}
BENCHMARK_CAPTURE(BM_Window, pips2, "pips2")
    ->Args({kFloat, 384, 512, 256, 6})
    ->Args({kHalf, 384, 512, 256, 6})
    ->Args({kFloat, 512, 896, 256, 8})
    ->Args({kHalf, 512, 896, 256, 8})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_Window, small, "small")
    ->Args({kFloat, 384, 512, 256, 6})
    ->Args({kHalf, 384, 512, 256, 6})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

// One training step in float32 without the optimiser.
void BM_TrainingStep(benchmark::State& state) {
  ModelOptions options = PresetByName("small").value();
  options.context_blocks = 0;
  PointModel model(options);
  const torch::Tensor pictures = Pictures(kFrames, 192, 256);
  const torch::Tensor start = (torch::rand({64, 1, 2}) * 23).repeat({1, kFrames, 1});
  for ([[maybe_unused]] auto _ : state) {
    torch::Tensor loss = torch::zeros({});
    for (const auto& xy : model->Unroll(model->Encode(pictures), start, 3).positions) loss = loss + xy.abs().sum();
    loss.backward();
    model->zero_grad();
  }
}
BENCHMARK(BM_TrainingStep)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);  // as what is served
  const char* threads = std::getenv("HOLDFAST_BENCHMARK_THREADS");
  torch::set_num_threads(threads == nullptr ? 2 : std::atoi(threads));
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
