// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/long_slices.h"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <thread>

namespace holdfast {
namespace {

// The kernel's struct sched_attr begins so: size, policy, flags (64 bits), nice, priority, slice (64 bits).
using Attributes = std::array<uint32_t, 12>;

uint64_t SliceOfThisThread() {
  Attributes attributes{};
  EXPECT_EQ(syscall(SYS_sched_getattr, 0, attributes.data(), sizeof attributes, 0U), 0);
  return uint64_t{attributes[7]} << 32 | attributes[6];
}

struct Found {
  uint64_t slice = 0;
  uint64_t childs_slice = 0;
  int policy = -1;
  int nice = -1;
};

Found OfAThread() {
  Found found;
  std::thread([&found] {
    RunInLongSlices();
    found = {SliceOfThisThread(), 0, sched_getscheduler(0), getpriority(PRIO_PROCESS, 0)};
    std::thread([&found] { found.childs_slice = SliceOfThisThread(); }).join();
  }).join();
  return found;
}

TEST(LongSlicesTest, AThreadAndThoseItCreatesRunLongerAtATimeAndNobodyElse) {
  const uint64_t before = SliceOfThisThread();
  const Found found = OfAThread();
  EXPECT_EQ(SliceOfThisThread(), before);
  if (found.slice == 0) GTEST_SKIP() << "this kernel has no slices of a thread's own";
  EXPECT_GT(found.slice, before);
  EXPECT_EQ(found.childs_slice, found.slice);
}

TEST(LongSlicesTest, PriorityAndPolicyStay) {
  const Found found = OfAThread();
  EXPECT_EQ(found.policy, sched_getscheduler(0));
  EXPECT_EQ(found.nice, getpriority(PRIO_PROCESS, 0));
}

}  // namespace
}  // namespace holdfast
