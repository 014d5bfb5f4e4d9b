// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "server/access/access_list.h"

namespace holdfast {

// Lets callers in whose token the server knows, or all of them where it has no list, and counts what each has open.
// Thread-safe.
class Gatekeeper {
 public:
  // A caller's place among its open streams, given back when it goes away. The gatekeeper must outlive it.
  class Pass {
   public:
    Pass() = default;
    Pass(Pass&& other) noexcept
        : owner_(std::exchange(other.owner_, nullptr)), leaving_(other.leaving_), grant_(std::move(other.grant_)) {}
    Pass& operator=(Pass&& other) = delete;
    ~Pass() { GiveBack(); }
    // The stream has only its last word to be read, after which the caller may come back at once: it no longer counts
    // among those that are open, but as one of as many that may be leaving.
    void Leave();
    // Gives the place back before its end; the grant stays.
    void GiveBack();
    const Grant& grant() const { return grant_; }  // of no name where the server has no list

   private:
    friend class Gatekeeper;
    Pass(Gatekeeper* owner, Grant grant) : owner_(owner), grant_(std::move(grant)) {}
    Gatekeeper* owner_ = nullptr;  // null: not counted
    bool leaving_ = false;
    Grant grant_;
  };

  // 'token_file' as AccessList::Parse has it; empty: everybody is let in. 'clock' must outlive the result.
  static absl::StatusOr<std::unique_ptr<Gatekeeper>> Create(const std::string& token_file, const Clock& clock,
                                                            std::shared_ptr<spdlog::logger> log);

  // 'authorization' is the metadata of that name, "Bearer TOKEN"; empty where there is none. 'peer' is for the log.
  // UNAUTHENTICATED when there has to be a token and this is none that the server knows.
  absl::StatusOr<Grant> Check(absl::string_view authorization, absl::string_view peer) ABSL_LOCKS_EXCLUDED(mutex_);
  // The same for a stream. RESOURCE_EXHAUSTED when the caller has as many open as it may.
  absl::StatusOr<Pass> Admit(absl::string_view authorization, absl::string_view peer) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  Gatekeeper(std::unique_ptr<AccessFile> file, const Clock& clock, std::shared_ptr<spdlog::logger> log)
      : file_(std::move(file)), clock_(clock), log_(std::move(log)) {}
  struct Streams {
    int open = 0;
    int leaving = 0;
  };
  void MoveToLeaving(const std::string& name) ABSL_LOCKS_EXCLUDED(mutex_);
  void Release(const std::string& name, bool leaving) ABSL_LOCKS_EXCLUDED(mutex_);
  void LogRefusal(absl::string_view peer) ABSL_LOCKS_EXCLUDED(mutex_);

  const std::unique_ptr<AccessFile> file_;  // null: everybody is let in
  const Clock& clock_;
  const std::shared_ptr<spdlog::logger> log_;

  absl::Mutex mutex_;
  absl::flat_hash_map<std::string, Streams> streams_ ABSL_GUARDED_BY(mutex_);  // of the names that have some
  std::optional<SteadyTime> logged_ ABSL_GUARDED_BY(mutex_);                   // when a refusal was last written down
  int64_t unlogged_ ABSL_GUARDED_BY(mutex_) = 0;                               // refusals since
};

}  // namespace holdfast
