// SPDX-License-Identifier: Apache-2.0
#include "model/shares.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <atomic>

namespace holdfast {
namespace {

// Equal shares, two a thread or more: beside a busy neighbour one thread gets more of the processor than another, which
// then has something left to take. A multiple of the threads, as far as the shares' sizes allow.
int64_t SharesOf(int64_t count, ShareSize size, int64_t threads) {
  const int64_t needed = at::divup(count, size.most), possible = std::max<int64_t>(1, count / size.least);
  const int64_t wanted = std::min(std::max(2 * threads, at::divup(needed, threads) * threads), possible);
  return std::max(needed, wanted > threads ? wanted - wanted % threads : wanted);
}

// How many of the shares go to threads. The last round counts where it keeps more than half of them busy.
int64_t SharedOut(int64_t shares, int64_t threads) {
  const int64_t last_round = shares % threads;
  return 2 * last_round > threads ? shares : shares - last_round;
}

// Inside a parallel region: operations of the calling thread run on it alone until the region ends. OpenMP would see to
// that, but oneDNN chooses its kernels by the number of threads that it is told of.
void ComputeAlone() {
  // A thread's first call sets the number that all have in common; there is one flag for it here and one in LibTorch.
  at::internal::lazy_init_num_threads();
  at::get_num_threads();
#ifdef _OPENMP
  omp_set_num_threads(1);
#endif
}

}  // namespace

void ForEachShare(int64_t count, ShareSize size, absl::FunctionRef<void(int64_t begin, int64_t end)> work) {
  if (count <= 0) return;
  const int64_t threads = at::get_num_threads();
  const int64_t shares = SharesOf(count, size, threads);
  const int64_t shared_out = SharedOut(shares, threads);
  std::atomic<int64_t> next{0};
  const auto take_shares = [&](int64_t, int64_t) {
    if (at::in_parallel_region()) ComputeAlone();
    for (int64_t i = next++; i < shared_out; i = next++) work(i * count / shares, (i + 1) * count / shares);
  };
  if (shared_out > 0) at::parallel_for(0, threads, /*grain_size=*/1, take_shares);  // once on each thread
  const int64_t rest = shared_out * count / shares;
  if (rest < count) work(rest, count);
}

}  // namespace holdfast
