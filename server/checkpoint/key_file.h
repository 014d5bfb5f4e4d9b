// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "server/checkpoint/key_ring.h"

namespace holdfast {

// The keys of a file, as it is now: a changed file is read again by the next who asks, at most once in kCheckPeriod. A
// file that has become wrong or is gone changes nothing but for a warning in the log. Thread-safe.
class KeyFile {
 public:
  static constexpr absl::Duration kCheckPeriod = absl::Seconds(1);
  static constexpr int64_t kMaxFileBytes = 1 << 20;

  // Reads the file for the first time; errors name it. 'clock' must outlive the result.
  static absl::StatusOr<std::unique_ptr<KeyFile>> Open(std::string path, const Clock& clock,
                                                       std::shared_ptr<spdlog::logger> log);

  std::shared_ptr<const KeyRing> Keys() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // What a file has to have in common with another one to be taken for the same.
  struct Stamp {
    int64_t changed_s = 0;
    int64_t changed_ns = 0;
    int64_t bytes = 0;
    uint64_t inode = 0;
    friend bool operator==(const Stamp& a, const Stamp& b) {
      return a.changed_s == b.changed_s && a.changed_ns == b.changed_ns && a.bytes == b.bytes && a.inode == b.inode;
    }
  };

  KeyFile(std::string path, const Clock& clock, std::shared_ptr<spdlog::logger> log)
      : path_(std::move(path)), clock_(clock), log_(std::move(log)) {}
  std::optional<Stamp> Look() const;
  absl::Status ReadLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::string path_;
  const Clock& clock_;
  const std::shared_ptr<spdlog::logger> log_;

  absl::Mutex mutex_;
  std::shared_ptr<const KeyRing> keys_ ABSL_GUARDED_BY(mutex_);  // null before the first reading only
  std::optional<Stamp> stamp_ ABSL_GUARDED_BY(mutex_);  // of the file when it was last read; empty: it was not there
  SteadyTime checked_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
