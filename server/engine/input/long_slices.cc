// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/long_slices.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdint>

namespace holdfast {
namespace {

constexpr uint64_t kSliceNanoseconds = 30'000'000;  // the kernel's own choice is about 3 ms

// As linux/sched/types.h has it, which cannot be included beside sched.h.
struct SchedulingAttributes {
  uint32_t size = sizeof(SchedulingAttributes);
  uint32_t policy = 0;
  uint64_t flags = 0;
  int32_t nice = 0;
  uint32_t priority = 0;
  uint64_t runtime = 0;  // of an ordinary thread: its slice
  uint64_t deadline = 0;
  uint64_t period = 0;
};

}  // namespace

void RunInLongSlices() {
  constexpr int kThisThread = 0;
  SchedulingAttributes attributes;
  if (syscall(SYS_sched_getattr, kThisThread, &attributes, sizeof attributes, 0U) != 0) return;
  if (attributes.policy != SCHED_OTHER) return;  // whoever chose another policy knows better
  attributes.runtime = kSliceNanoseconds;
  syscall(SYS_sched_setattr, kThisThread, &attributes, 0U);
}

}  // namespace holdfast
