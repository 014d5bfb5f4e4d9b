// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/key_file.h"

#include <sys/stat.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "io/file_io.h"

namespace holdfast {

absl::StatusOr<std::unique_ptr<KeyFile>> KeyFile::Open(std::string path, const Clock& clock,
                                                       std::shared_ptr<spdlog::logger> log) {
  std::unique_ptr<KeyFile> file(new KeyFile(std::move(path), clock, std::move(log)));
  absl::MutexLock lock(&file->mutex_);
  if (absl::Status status = file->ReadLocked(); !status.ok()) return status;
  return file;
}

std::shared_ptr<const KeyRing> KeyFile::Keys() {
  absl::MutexLock lock(&mutex_);
  if (clock_.Since(checked_) < kCheckPeriod) return keys_;
  checked_ = clock_.SteadyNow();
  if (Look() == stamp_) return keys_;
  if (absl::Status status = ReadLocked(); status.ok()) {
    log_->info(absl::StrCat("new checkpoint keys; sealing with ", keys_->sealing().id));
  } else {
    log_->warn(absl::StrCat("the checkpoint keys stay as they were: ", status.message()));
  }
  return keys_;
}

// Follows links: platforms exchange a secret's file by pointing a link elsewhere.
std::optional<KeyFile::Stamp> KeyFile::Look() const {
  struct stat found {};
  if (::stat(path_.c_str(), &found) != 0) return std::nullopt;
  return Stamp{found.st_mtim.tv_sec, found.st_mtim.tv_nsec, found.st_size, found.st_ino};
}

// Looks before it reads: a file that changes in between is read once more.
absl::Status KeyFile::ReadLocked() {
  checked_ = clock_.SteadyNow();
  stamp_ = Look();
  const absl::StatusOr<std::string> text = ReadFile(path_, kMaxFileBytes);
  if (!text.ok()) return absl::Status(text.status().code(), absl::StrCat("checkpoint keys: ", text.status().message()));
  absl::StatusOr<KeyRing> keys = KeyRing::Parse(*text);
  if (!keys.ok()) {
    return absl::Status(keys.status().code(), absl::StrCat("checkpoint keys ", path_, ": ", keys.status().message()));
  }
  keys_ = std::make_shared<const KeyRing>(*std::move(keys));
  return absl::OkStatus();
}

}  // namespace holdfast
