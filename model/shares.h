// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "absl/functional/function_ref.h"

namespace holdfast {

// How many things a thread may get at a time: fewer are not worth it, more would leave others waiting for it.
struct ShareSize {
  int64_t least = 1;
  int64_t most = 1;
};

// Calls work(begin, end) for shares of 'count' things that together are all of them, [0, count). Parallel over shares,
// not inside operations: each runs on one of the threads that operations of the calling thread would use, which takes
// the next share when it is done with one, and LibTorch and oneDNN use one thread inside. So the threads meet once, at
// the end, and not after every operation, where the slowest of them, beside a busy neighbour, holds up the others.
// What would leave half of the threads idle is not shared: it comes last, on the calling thread, and its operations use
// all threads.
//
// Throws what the first share threw that failed, when all threads have stopped. LibTorch's settings of the calling
// thread (InferenceMode) are not those of the others.
void ForEachShare(int64_t count, ShareSize size, absl::FunctionRef<void(int64_t begin, int64_t end)> work);

}  // namespace holdfast
