// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <thread>

namespace holdfast {

// SIGTERM and SIGINT as a flag: the first sets it, a second ends the process at once. Make it before any other thread,
// which then inherits the blocked signals; one object per process.
class SignalFlag {
 public:
  SignalFlag();
  ~SignalFlag();
  const std::atomic<bool>& requested() const { return requested_; }

 private:
  void Watch();

  std::atomic<bool> requested_{false};
  std::atomic<bool> closing_{false};
  std::thread thread_;
};

}  // namespace holdfast
