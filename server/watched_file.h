// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {

// What a file has to have in common with another one to be taken for the same. 'changed' is the time that nobody can
// set, of its content, owner and mode.
struct FileStamp {
  int64_t changed_s = 0;
  int64_t changed_ns = 0;
  int64_t bytes = 0;
  uint64_t inode = 0;
  friend bool operator==(const FileStamp& a, const FileStamp& b) {
    return a.changed_s == b.changed_s && a.changed_ns == b.changed_ns && a.bytes == b.bytes && a.inode == b.inode;
  }
};

// Of the file as it is now; empty when there is none. Follows links: platforms exchange a secret's file by pointing a
// link elsewhere.
std::optional<FileStamp> LookAt(const std::string& path);

inline constexpr absl::Duration kFileCheckPeriod = absl::Seconds(1);
inline constexpr int64_t kMaxWatchedFileBytes = 1 << 20;

// The text of a small file, its errors naming 'what' and the path.
absl::StatusOr<std::string> ReadWatched(const std::string& path, absl::string_view what);

// What a small file says, as it is now: a changed file is read again by the next who asks, at most once in
// kFileCheckPeriod. One that has become wrong, cannot be read or is gone changes nothing but for a warning in the log.
// T is immutable: who has it may keep it. Thread-safe.
template <typename T>
class WatchedFile {
 public:
  struct Options {
    std::string path;
    std::string what;  // "checkpoint keys", for logs and errors
    // No error may quote the text, which may be secret.
    std::function<absl::StatusOr<T>(absl::string_view text)> parse;
    std::function<std::string(const T&)> describe;  // for the log, after the file has changed
  };
  // Reads the file for the first time; errors name it. 'clock' must outlive the result.
  static absl::StatusOr<std::unique_ptr<WatchedFile>> Open(Options options, const Clock& clock,
                                                           std::shared_ptr<spdlog::logger> log) {
    std::unique_ptr<WatchedFile> file(new WatchedFile(std::move(options), clock, std::move(log)));
    absl::MutexLock lock(&file->mutex_);
    if (absl::Status status = file->ReadLocked(); !status.ok()) return status;
    return file;
  }

  std::shared_ptr<const T> Current() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    if (clock_.Since(checked_) < kFileCheckPeriod) return content_;
    checked_ = clock_.SteadyNow();
    if (LookAt(options_.path) == stamp_) return content_;
    if (absl::Status status = ReadLocked(); status.ok()) {
      complaint_.clear();
      log_->info(absl::StrCat("new ", options_.what, ": ", options_.describe(*content_)));
    } else if (status.message() != complaint_) {
      complaint_ = std::string(status.message());
      log_->warn(absl::StrCat("the ", options_.what, " stay as they were: ", complaint_));
    }
    return content_;
  }

 private:
  WatchedFile(Options options, const Clock& clock, std::shared_ptr<spdlog::logger> log)
      : options_(std::move(options)), clock_(clock), log_(std::move(log)) {}

  // Looks before it reads: a file that changes in between is read once more. So is one that could not be read, for
  // reasons that may pass.
  absl::Status ReadLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    checked_ = clock_.SteadyNow();
    stamp_ = LookAt(options_.path);
    const absl::StatusOr<std::string> text = ReadWatched(options_.path, options_.what);
    if (!text.ok()) {
      stamp_.reset();
      return text.status();
    }
    absl::StatusOr<T> content = options_.parse(*text);
    if (!content.ok()) {
      const absl::Status& status = content.status();
      return absl::Status(status.code(), absl::StrCat(options_.what, " ", options_.path, ": ", status.message()));
    }
    content_ = std::make_shared<const T>(*std::move(content));
    return absl::OkStatus();
  }

  const Options options_;
  const Clock& clock_;
  const std::shared_ptr<spdlog::logger> log_;

  absl::Mutex mutex_;
  std::shared_ptr<const T> content_ ABSL_GUARDED_BY(mutex_);  // null before the first reading only
  std::optional<FileStamp> stamp_ ABSL_GUARDED_BY(mutex_);    // of the file when it was last read; empty: it was not
  std::string complaint_ ABSL_GUARDED_BY(mutex_);             // what was warned of since
  SteadyTime checked_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
