// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

// Lets malloc keep freed memory for the next tensor, for programs that run the network. A choice of the user's wins:
// nothing happens when MALLOC_MMAP_THRESHOLD_, MALLOC_TRIM_THRESHOLD_ or MALLOC_ARENA_MAX is set, or GLIBC_TUNABLES
// says something of malloc. Call it first thing in main, before there are threads.
//
// By default glibc takes every block beyond 32 MiB from the kernel and gives it back when it is freed, as do most
// blocks of the heaps of threads. A network's operators free and take such blocks hundreds of times a second, and each
// comes with page faults and zeroes again: half of the encoder's time at 512x384. One heap for all threads has room for
// blocks of any size, and memory that one thread has freed serves the others. The process stays as large as it ever
// was, which the budgets of sessions bound. LibTorch's allocator calls malloc, so this reaches its tensors.
void KeepFreedMemory();

}  // namespace holdfast
