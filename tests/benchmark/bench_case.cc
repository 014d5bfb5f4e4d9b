// SPDX-License-Identifier: Apache-2.0
#include "tests/benchmark/bench_case.h"

#include <benchmark/benchmark.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <optional>
#include <utility>

#include "absl/strings/str_join.h"
#include "tests/benchmark/peak_memory.h"

namespace holdfast {

std::string CaseName::Text() const {
  return absl::StrJoin({stage, preset, precision, size, points, std::to_string(threads)}, "/");
}

void RegisterCase(BenchCase bench) {
  const std::string name = bench.name.Text();
  auto measure = [bench = std::move(bench), first = true,
                  peak = std::optional<int64_t>()](benchmark::State& state) mutable {
    const torch::NoGradGuard guard;
    torch::set_num_threads(bench.name.threads);
    const std::function<void()> run = bench.prepare();
    if (std::exchange(first, false)) {
      const PeakMemory memory;
      run();
      peak = memory.Bytes();
    }
    for ([[maybe_unused]] auto _ : state) run();
    state.counters["operations"] = bench.work.operations;
    state.counters["bytes"] = bench.work.bytes;
    if (peak) state.counters["peak_bytes"] = static_cast<double>(*peak);
  };
  benchmark::RegisterBenchmark(name.c_str(), std::move(measure))->UseRealTime()->Unit(benchmark::kMillisecond);
}

}  // namespace holdfast
