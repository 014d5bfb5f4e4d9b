// SPDX-License-Identifier: Apache-2.0
// Two processes of a training, as threads of a test.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <thread>

#include "tests/support/free_port.h"
#include "tests/support/status_matchers.h"
#include "training/distributed.h"

namespace holdfast {

inline GroupOptions TwoProcesses() { return {0, 2, "127.0.0.1", FreePort(), absl::Minutes(1)}; }

// Runs 'body' as each of two ranks, in threads, with all else as 'options' say.
inline void AsTwoRanks(const GroupOptions& options, const std::function<void(ProcessGroup&)>& body) {
  const auto run = [&](int64_t rank) {
    GroupOptions mine = options;
    mine.rank = rank;
    auto group = ProcessGroup::Join(mine, torch::kCPU);
    ASSERT_THAT(group, IsOk());
    body(**group);
  };
  std::thread other([&] { run(1); });
  run(0);
  other.join();
}

inline void AsTwoRanks(const std::function<void(ProcessGroup&)>& body) { AsTwoRanks(TwoProcesses(), body); }

}  // namespace holdfast
