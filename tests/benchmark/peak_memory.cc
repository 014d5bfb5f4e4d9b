// SPDX-License-Identifier: Apache-2.0
#include "tests/benchmark/peak_memory.h"

#include <malloc.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace holdfast {
namespace {

// A line of /proc/self/status, in bytes; 0 where there is none.
int64_t StatusBytes(const std::string& name) {
  std::ifstream status("/proc/self/status");
  std::string word;
  int64_t kilobytes = 0;
  while (status >> word) {
    if (word == name + ":" && status >> kilobytes) return kilobytes * 1024;
  }
  return 0;
}

bool ResetHighWaterMark() {
  std::ofstream clear("/proc/self/clear_refs");
  return static_cast<bool>(clear << "5" << std::flush);
}

}  // namespace

PeakMemory::PeakMemory() {
  malloc_trim(0);
  reset_ = ResetHighWaterMark();
  before_ = StatusBytes("VmHWM");
}

std::optional<int64_t> PeakMemory::Bytes() const {
  if (!reset_) return std::nullopt;
  return std::max<int64_t>(0, StatusBytes("VmHWM") - before_);
}

}  // namespace holdfast
