// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_set.h"
#include "absl/synchronization/mutex.h"
#include "server/unread_service.h"

namespace holdfast {

// grpc.health.v1: whether the server serves, to everybody. It does not read which service is asked for, so that no
// stranger makes it take in a message: there is one service. Thread-safe.
class HealthService final : public UnreadService {
 public:
  // What they send is not read and lies here until they go.
  static constexpr int kMaxWatchers = 32;

  HealthService();
  // Tells the watchers too. It is not serving at first.
  void Set(bool serving) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  class Watcher;
  Reactor* Check() ABSL_LOCKS_EXCLUDED(mutex_);
  Reactor* Watch() ABSL_LOCKS_EXCLUDED(mutex_);  // RESOURCE_EXHAUSTED beyond kMaxWatchers

  absl::Mutex mutex_;
  bool serving_ ABSL_GUARDED_BY(mutex_) = false;
  absl::flat_hash_set<Watcher*> watchers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
