// SPDX-License-Identifier: Apache-2.0
#include "program/network_process.h"

#include "absl/synchronization/mutex.h"
#include "program/freed_memory.h"
#include "program/openmp_wait.h"

namespace holdfast {

void PrepareForNetwork(char** argv) {
  ChooseOpenMpWait(argv);
  KeepFreedMemory();
#ifdef NDEBUG
  // Debian builds abseil with the search for cycles of locks, which takes a lock of its own at every lock.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
#endif
}

}  // namespace holdfast
