// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {

// "Stop soon." Thread-safe; set once.
class StopSignal {
 public:
  void Stop();
  bool stopped() const;
  // 'on_stop' runs once, on the thread that stops, or right here when it is stopped already. An empty function takes
  // the earlier one away and blocks while that runs.
  void SetCallback(std::function<void()> on_stop);

 private:
  mutable absl::Mutex mutex_;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::function<void()> on_stop_ ABSL_GUARDED_BY(mutex_);
};

// Turns SIGINT and SIGTERM of this process into a StopSignal; a second one ends the process at once. Construct it
// before any thread is started: these inherit that the signals are blocked.
class InterruptWatcher {
 public:
  // 'stop' must outlive the watcher.
  explicit InterruptWatcher(StopSignal& stop);
  ~InterruptWatcher();

 private:
  void Watch();

  StopSignal& stop_;
  int signals_ = -1;  // file descriptors
  int over_ = -1;
  std::thread thread_;
};

}  // namespace holdfast
