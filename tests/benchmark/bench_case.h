// SPDX-License-Identifier: Apache-2.0
// What bench.py measures and how it finds it: cases of one form, whose names say where they belong in its table.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "api/image_size.h"
#include "tests/benchmark/network_work.h"

namespace holdfast {

// "stage/preset/precision/HEIGHTxWIDTH/points/threads"; what a stage does not depend on is "-".
struct CaseName {
  std::string stage;
  std::string preset = "-";
  std::string precision = "-";
  std::string size = "-";
  std::string points = "-";
  int threads = 1;
  std::string Text() const;
};

struct BenchCase {
  CaseName name;
  Work work;  // of one run; nothing: it is not counted
  // Makes the input, outside of what is measured, and returns what is. Called with the case's number of threads set.
  std::function<std::function<void()>()> prepare;
};

// Measures it in real time, without gradients, with counters "operations", "bytes" and "peak_bytes" (PeakMemory, of the
// first run, which is not among those that are timed).
void RegisterCase(BenchCase bench);

struct NumberType {  // of weights and maps
  const char* name;
  torch::ScalarType type;
};

// What the cases differ in.
struct BenchGrid {
  std::vector<int> threads;            // 1 and as many as LibTorch is to have
  std::vector<NumberType> precisions;  // bfloat16 where the processor has it
  std::vector<std::string> presets = {"paper", "pips2", "small"};
  std::vector<ImageSize> sizes = {{320, 256}, {512, 384}, {896, 512}};
  std::vector<int64_t> points = {1, 64, 256, 1024};
};

void RegisterCeilings(const BenchGrid& grid);       // the machine's own
void RegisterPictureStages(const BenchGrid& grid);  // decode, flow
void RegisterNetworkStages(const BenchGrid& grid);  // encode, attention, pyramid, correlation, update, window

}  // namespace holdfast
