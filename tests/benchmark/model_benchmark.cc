// SPDX-License-Identifier: Apache-2.0
// holdfast-model-benchmark: the machine's ceilings and the stages of tracking, which bench.py makes a table of (`make
// bench`), and single operators of the network for who works on them (--benchmark_filter=BM_). Run it alone on the
// machine.
//   HOLDFAST_BENCHMARK_THREADS   of LibTorch; default: all processors. Stages and ceilings are there with one, too
//   HOLDFAST_BENCHMARK_BFLOAT16  1: stages and ceilings in bfloat16 too, where the processor has to emulate it
#include <benchmark/benchmark.h>
#include <torch/nn/modules/conv.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdlib>

#include "model/ops/convolution.h"
#include "model/ops/correlation.h"
#include "model/ops/instance_norm.h"
#include "model/ops/patch_attention.h"
#include "model/point_model.h"
#include "model/precision.h"
#include "model/presets.h"
#include "model/thread_count.h"
#include "program/network_process.h"
#include "tests/benchmark/bench_case.h"

namespace holdfast {
namespace {

constexpr int64_t kFrames = 24;

constexpr int64_t kFloat = 0;
constexpr int64_t kHalf = 1;

torch::ScalarType TypeOf(int64_t precision) { return precision == kHalf ? torch::kBFloat16 : torch::kFloat32; }

// Forward and backward, as training runs it. Argument: precision of the maps.
void BM_CorrelationGradient(benchmark::State& state) {
  const auto maps = torch::randn({kFrames, 64, 24, 32}).to(TypeOf(state.range(0))).requires_grad_();
  const torch::Tensor templates = torch::randn({64, kFrames, 3, 64}).requires_grad_();
  const torch::Tensor xy = torch::rand({64, kFrames, 2}) * 24;
  for ([[maybe_unused]] auto _ : state) Correlate(BuildCells(maps, 4), templates, xy, 3).sum().backward();
}
BENCHMARK(BM_CorrelationGradient)->Arg(kFloat)->Arg(kHalf)->UseRealTime();

// Three pixels wide, of float32 maps without a gradient. Arguments: channels of x and of the result, height (1: over
// time), width, batch.
void BM_Convolution(benchmark::State& state) {
  const torch::NoGradGuard guard;
  const torch::Tensor x = torch::randn({state.range(4), state.range(0), state.range(2), state.range(3)})
                              .contiguous(torch::MemoryFormat::ChannelsLast);
  const auto repeat = [&](const auto& conv) {
    for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(Convolve(x, conv));
  };
  if (state.range(2) > 1) {
    torch::nn::Conv2d conv(torch::nn::Conv2dOptions(state.range(0), state.range(1), 3));
    UseChannelsLast(conv);
    repeat(conv);
  } else {
    Conv1d conv(torch::nn::Conv1dOptions(state.range(0), state.range(1), 3));
    conv->PackWeights();
    repeat(conv);
  }
}
BENCHMARK(BM_Convolution)
    ->Args({24, 24, 192, 256, 1})
    ->Args({32, 32, 96, 128, 1})
    ->Args({48, 48, 48, 64, 1})
    ->Args({64, 64, 96, 128, 1})
    ->Args({96, 96, 48, 64, 1})
    ->Args({128, 128, 48, 64, 1})
    ->Args({416, 256, 48, 64, 1})
    ->Args({48, 48, 1, 24, 64})
    ->Args({96, 96, 1, 24, 64})
    ->Args({192, 192, 1, 24, 64})
    ->Args({384, 384, 1, 24, 64})
    ->Args({384, 384, 1, 24, 4})
    ->Args({1024, 1024, 1, 24, 16})
    ->UseRealTime();

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

// One training step in float32 without the optimiser.
void BM_TrainingStep(benchmark::State& state) {
  ModelOptions options = PresetByName("small").value();
  options.context_blocks = 0;
  PointModel model(options);
  const torch::Tensor pictures = torch::randint(0, 256, {kFrames, 192, 256, 3}, torch::kUInt8);
  const torch::Tensor start = (torch::rand({64, 1, 2}) * 23).repeat({1, kFrames, 1});
  for ([[maybe_unused]] auto _ : state) {
    torch::Tensor loss = torch::zeros({});
    for (const auto& xy : model->Unroll(model->Encode(pictures), start, 3).positions) loss = loss + xy.abs().sum();
    loss.backward();
    model->zero_grad();
  }
}
BENCHMARK(BM_TrainingStep)->UseRealTime()->Unit(benchmark::kMillisecond);

BenchGrid Grid(bool fast_bfloat16) {
  const char* const threads = std::getenv("HOLDFAST_BENCHMARK_THREADS");
  const char* const forced = std::getenv("HOLDFAST_BENCHMARK_BFLOAT16");
  BenchGrid grid;
  grid.threads = {1};
  if (const int all = ThreadCount(threads == nullptr ? 0 : std::atoi(threads)); all > 1) {
    grid.threads.push_back(all);
  }
  grid.precisions = {{"float32", torch::kFloat32}};
  if (fast_bfloat16 || (forced != nullptr && std::atoi(forced) == 1)) {
    grid.precisions.push_back({"bfloat16", torch::kBFloat16});
  }
  return grid;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);  // as what is served
  benchmark::Initialize(&argc, argv);
  const bool fast_bfloat16 = holdfast::ComputesBFloat16Faster(torch::kCPU);
  const holdfast::BenchGrid grid = holdfast::Grid(fast_bfloat16);
  torch::set_num_threads(grid.threads.back());
  holdfast::RegisterCeilings(grid);
  holdfast::RegisterPictureStages(grid);
  holdfast::RegisterNetworkStages(grid);
  benchmark::AddCustomContext("threads", std::to_string(grid.threads.back()));
  benchmark::AddCustomContext("bfloat16", fast_bfloat16 ? "by the processor" : "emulated");
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
