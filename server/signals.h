// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <thread>

#include "absl/synchronization/notification.h"

namespace holdfast {

// SIGTERM and SIGINT: the first is what Wait waits for, a second ends the process at once. Make it before any other
// thread, which then inherits the blocked signals; one object per process.
class TerminationSignals {
 public:
  TerminationSignals();
  ~TerminationSignals();
  // Blocks until the first signal, which may have come before.
  void Wait() const { first_.WaitForNotification(); }

 private:
  void Watch();

  int stop_fd_;  // readable: the thread has to end
  absl::Notification first_;
  std::thread thread_;
};

}  // namespace holdfast
