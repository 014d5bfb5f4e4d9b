// SPDX-License-Identifier: Apache-2.0
// A library that has every thread's stack begin with 64 KiB of its own, as libraries of linear algebra do.
thread_local char large_thread_local[64 << 10];
