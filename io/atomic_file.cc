// SPDX-License-Identifier: Apache-2.0
#include "io/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <random>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "io/descriptor.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

std::string DirectoryOf(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  return parent.empty() ? "." : parent.string();
}

// Short, so that a long final name does not make it too long. Libraries that write pictures and videos choose their
// format by the suffix, so it stays the last thing of the name.
std::string TemporaryName(const std::string& path) {
  std::random_device random;
  const uint64_t number = (uint64_t{random()} << 32) | random();
  const std::string name = absl::StrCat(".holdfast-", absl::Hex(number, absl::kZeroPad16), ".tmp");
  return (fs::path(DirectoryOf(path)) / (name + fs::path(path).extension().string())).string();
}

// False with errno set.
bool WriteAll(int fd, absl::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return true;
}

absl::Status WriteNewFile(const std::string& path, absl::string_view bytes) {
  Descriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!file.valid()) return SystemError("create", path);
  if (!WriteAll(file.get(), bytes)) return SystemError("write", path);
  if (!file.Close()) return SystemError("close", path);
  return absl::OkStatus();
}

// Some file systems cannot sync a directory (EINVAL) and need not.
absl::Status Sync(const std::string& path, int flags) {
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | flags));
  if (!fd.valid()) return SystemError("open", path);
  if (::fsync(fd.get()) != 0 && errno != EINVAL) return SystemError("sync", path);
  return absl::OkStatus();
}

}  // namespace

PendingFile::PendingFile(std::string path) : path_(std::move(path)), temporary_(TemporaryName(path_)) {}

PendingFile::~PendingFile() {
  if (!committed_) ::unlink(temporary_.c_str());
}

absl::Status PendingFile::Commit() {
  if (absl::Status synced = Sync(temporary_, 0); !synced.ok()) return synced;
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) return SystemError("write", path_);
  committed_ = true;
  return Sync(DirectoryOf(path_), O_DIRECTORY);
}

absl::Status WriteAtomically(const std::string& path, const std::function<absl::Status(const std::string&)>& write) {
  PendingFile file(path);
  absl::Status status = write(file.temporary());
  if (status.ok()) status = file.Commit();
  return status.ok() ? status : absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
}

absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes) {
  return WriteAtomically(path, [bytes](const std::string& temporary) { return WriteNewFile(temporary, bytes); });
}

absl::Status CheckWritable(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return absl::InvalidArgumentError(absl::StrCat(path, ": is a directory"));
  if (const std::string directory = DirectoryOf(path); !fs::is_directory(directory, ignored)) {
    return absl::NotFoundError(absl::StrCat(path, ": there is no directory ", directory));
  }
  const PendingFile probe(path);
  const absl::Status made = WriteNewFile(probe.temporary(), "");
  return made.ok() ? made : absl::Status(made.code(), absl::StrCat(path, ": cannot be written: ", made.message()));
}

}  // namespace holdfast
