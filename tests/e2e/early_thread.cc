// SPDX-License-Identifier: Apache-2.0
// A library that starts a thread before main, as libraries of linear algebra do.
#include <unistd.h>

#include <thread>

__attribute__((constructor)) static void StartThread() {
  std::thread([] {
    for (;;) pause();
  }).detach();
}
