// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/engine/metrics.h"

namespace holdfast {

// Says at the door, at once, whether a session fits; what it reserves is held until its ticket dies. Thread-safe;
// must outlive its tickets.
class Admission {
 public:
  struct Limits {
    int max_sessions = 0;
    int64_t max_bytes = 0;
  };
  class Ticket {
   public:
    Ticket(Admission& admission, int64_t bytes) : admission_(admission), bytes_(bytes) {}
    ~Ticket() { admission_.Release(bytes_); }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;

   private:
    Admission& admission_;
    const int64_t bytes_;
  };

  Admission(const Limits& limits, EngineMetrics& metrics) : limits_(limits), metrics_(metrics) {}

  // 'bytes': the most that the session's features will take. An overload error says when to come back.
  absl::StatusOr<std::unique_ptr<Ticket>> Admit(int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Release(int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);

  const Limits limits_;
  EngineMetrics& metrics_;
  absl::Mutex mutex_;
  int sessions_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace holdfast
