// SPDX-License-Identifier: Apache-2.0
#include "program/freed_memory.h"

#include <malloc.h>

#include <cstdlib>
#include <limits>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

bool UserHasChosen() {
  for (const char* name : {"MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "MALLOC_ARENA_MAX"}) {
    if (std::getenv(name) != nullptr) return true;
  }
  const char* const tunables = std::getenv("GLIBC_TUNABLES");
  return tunables != nullptr && absl::StrContains(tunables, "glibc.malloc.");
}

}  // namespace

void KeepFreedMemory() {
#ifdef __GLIBC__
  if (UserHasChosen()) return;
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
  mallopt(M_ARENA_MAX, 1);
#endif
}

}  // namespace holdfast
