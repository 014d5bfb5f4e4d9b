// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <thread>

namespace holdfast {

// Threads that compute: as many as asked for, or all cores for 0. LibTorch's own choice may be a single one.
inline int ThreadCount(int asked) {
  return asked > 0 ? asked : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

}  // namespace holdfast
