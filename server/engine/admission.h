// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/types/span.h"
#include "server/engine/metrics.h"
#include "server/engine/work_meter.h"

namespace holdfast {

// Says at the door, at once, whether a session fits; what it reserves is held until its ticket dies. Thread-safe;
// must outlive its tickets.
class Admission {
 public:
  struct Limits {
    int max_sessions = 0;
    int64_t max_bytes = 0;
  };
  // What a session asks for, in one of the ways in which it may be served.
  struct Demand {
    int64_t bytes = 0;             // the most that its features will take
    double frames_per_second = 0;  // that it is promised
    bool insists = false;          // on that rate: rather refused than served more slowly when it is alone
    WorkMeter::FrameWork work;
    int64_t points = 0;  // that it will have at once
  };
  struct Load {
    int sessions = 0;
    int64_t points = 0;  // tracked now
    double work = 0;     // promised, in point-frames a second
  };
  class Ticket {
   public:
    Ticket(Admission& admission, const Demand& demand, size_t choice)
        : admission_(admission), demand_(demand), choice_(choice) {}
    ~Ticket() { admission_.Release(*this); }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;
    size_t choice() const { return choice_; }  // which of the demands was met
    // The session tracks this many points now, which may be more than it asked for. From one thread.
    void SetPoints(int64_t points) { admission_.SetPoints(*this, points); }

   private:
    friend class Admission;
    Admission& admission_;
    const Demand demand_;
    const size_t choice_;
    int64_t points_ = 0;  // guarded by the admission's mutex
  };

  // Both must outlive the admission.
  Admission(const Limits& limits, const WorkMeter& meter, EngineMetrics& metrics)
      : limits_(limits), meter_(meter), metrics_(metrics) {}

  // Meets the first of the demands whose work fits; each takes less of it than the one before, and no less memory.
  // An overload error says when to come back. REQUIRES: there is one.
  absl::StatusOr<std::unique_ptr<Ticket>> Admit(absl::Span<const Demand> demands) ABSL_LOCKS_EXCLUDED(mutex_);
  // The same of any demand: whether all sessions are there that there may be.
  absl::Status CheckPlaces() ABSL_LOCKS_EXCLUDED(mutex_);
  Load load() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  absl::Status CheckPlacesLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool WorkFits(const Demand& demand, double budget) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status RefuseWork(absl::Span<const Demand> demands, double budget) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status RefuseMemory(absl::Span<const Demand> demands) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void SetPoints(Ticket& ticket, int64_t points) ABSL_LOCKS_EXCLUDED(mutex_);
  void Release(const Ticket& ticket) ABSL_LOCKS_EXCLUDED(mutex_);

  const Limits limits_;
  const WorkMeter& meter_;
  EngineMetrics& metrics_;
  mutable absl::Mutex mutex_;
  int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  Load load_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
