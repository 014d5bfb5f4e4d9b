// SPDX-License-Identifier: Apache-2.0
// How programs are asked to end: SIGINT and SIGTERM as an event that callers listen to, and the exit code afterwards.
#pragma once

#include <atomic>
#include <csignal>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {

// "Stop soon." Thread-safe; set once.
class StopSignal {
 public:
  // 'signal': the one that asks for it. Returns whether a callback took it; false where it was stopped before, too.
  bool Stop(int signal = SIGINT);
  bool stopped() const { return signal() != 0; }
  int signal() const { return signal_; }  // 0 until it is stopped
  // 'on_stop' runs once, on the thread that stops, or right here when it is stopped already. An empty function takes
  // the earlier one away and blocks while that runs.
  void SetCallback(std::function<void()> on_stop);

 private:
  void Tell() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::atomic<int> signal_{0};
  absl::Mutex mutex_;
  std::function<void()> on_stop_ ABSL_GUARDED_BY(mutex_);
  bool told_ ABSL_GUARDED_BY(mutex_) = false;
};

// The code of a program that a signal has ended, as shells report it: 130 for SIGINT, 143 for SIGTERM.
constexpr int SignalExitCode(int signal) { return 128 + signal; }

// Signals that come so soon after the one that was taken ask for the same: timeout(1) sends its own to the process and
// to its group, and a supervisor may do as much beside a terminal's Ctrl-C.
inline constexpr absl::Duration kSameRequest = absl::Seconds(1);

// Turns SIGINT and SIGTERM of this process into a StopSignal. One that nobody listens to ends the process at once with
// SignalExitCode, and so does the second one that is no part of the first. Construct it before the program's own
// threads are started: these inherit that the signals are blocked, and no call of theirs is interrupted. Threads of
// libraries, which may be there before, pass the signals on. One object at a time.
class TerminationWatcher {
 public:
  // 'stop' must outlive the watcher.
  explicit TerminationWatcher(StopSignal& stop);
  // By a clock of the caller's, which must outlive it too.
  TerminationWatcher(StopSignal& stop, const Clock& clock);
  ~TerminationWatcher();

 private:
  void Watch();

  StopSignal& stop_;
  const Clock& clock_;
  std::thread thread_;
};

}  // namespace holdfast
