// SPDX-License-Identifier: Apache-2.0
#include "io/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <random>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "io/descriptor.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

std::string DirectoryOf(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  return parent.empty() ? "." : parent.string();
}

// Or nothing yet. Not a device, a pipe or a socket, in whose place a rename would put a file; a directory resists that.
bool IsFile(const std::string& path) {
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  return !fs::exists(status) || fs::is_regular_file(status) || fs::is_directory(status);
}

// Where the links of the last name lead, be there a file or not.
std::string Followed(const std::string& path) {
  constexpr int kMaxLinks = 40;  // as the system has it
  fs::path target = path;
  for (int links = 0; links < kMaxLinks; ++links) {
    std::error_code no_link;
    const fs::path next = fs::read_symlink(target, no_link);
    if (no_link) return target.string();
    target = target.parent_path() / next;
  }
  return path;
}

constexpr absl::string_view kTemporaryStart = ".holdfast-", kTemporaryEnd = ".tmp";

// Short, so that a long final name does not make it too long. Libraries that write pictures and videos choose their
// format by the suffix, so it stays the last thing of the name.
std::string TemporaryName(const std::string& directory, const std::string& path) {
  std::random_device random;
  const uint64_t number = (uint64_t{random()} << 32) | random();
  const std::string name = absl::StrCat(kTemporaryStart, absl::Hex(number, absl::kZeroPad16), kTemporaryEnd);
  return (fs::path(directory) / (name + fs::path(path).extension().string())).string();
}

bool IsTemporaryName(absl::string_view name) {
  if (!absl::ConsumePrefix(&name, kTemporaryStart)) return false;
  const size_t digits = std::min(name.find_first_not_of("0123456789abcdef"), name.size());
  return digits == 16 && absl::StartsWith(name.substr(digits), kTemporaryEnd);
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

absl::Status Sync(const std::string& path) {
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid()) return SystemError("open", path);
  if (::fsync(fd.get()) != 0 && errno != EINVAL) return SystemError("sync", path);
  return absl::OkStatus();
}

// Some directories cannot be read or synced. Without it a crash may bring back what had the name before, as whole.
void TrySyncDirectory(const std::string& path) {
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECTORY));
  if (fd.valid()) ::fsync(fd.get());
}

// 'flags' are further ones to open 'path' with.
absl::Status CopyInto(const std::string& path, int flags, const std::string& from) {
  const Descriptor source(::open(from.c_str(), O_RDONLY | O_CLOEXEC));
  if (!source.valid()) return SystemError("open", from);
  Descriptor target(::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC | flags));
  if (!target.valid()) return SystemError("open", path);
  std::array<char, 1 << 16> bytes;
  for (ssize_t count; (count = ::read(source.get(), bytes.data(), bytes.size())) != 0;) {
    if (count < 0) return SystemError("read", from);
    if (!WriteAll(target.get(), {bytes.data(), static_cast<size_t>(count)})) return SystemError("write", path);
  }
  return target.Close() ? absl::OkStatus() : SystemError("close", path);
}

// File systems that know no modes have none to keep.
void TryKeepMode(const std::string& path, const std::string& temporary) {
  struct stat old;
  if (::stat(path.c_str(), &old) == 0 && S_ISREG(old.st_mode)) ::chmod(temporary.c_str(), old.st_mode & 0777);
}

// Somebody else's file where only owners may rename, or one that is mounted by itself, as into a container: it may be
// writable all the same.
bool IsBoundToItsName(int rename_error) {
  return rename_error == EPERM || rename_error == EACCES || rename_error == EBUSY || rename_error == EXDEV;
}

// With the rights that the process has now, as open() does.
bool IsWritable(const std::string& path) { return ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0; }

// Of the temporary file. Where 'path' is no file its directory may take none, as /dev.
std::string WorkingDirectory(bool is_file, const std::string& path) {
  std::error_code ignored;
  return is_file ? DirectoryOf(path) : fs::temp_directory_path(ignored).string();
}

}  // namespace

PendingFile::PendingFile(const std::string& path)
    : is_file_(IsFile(path)),
      path_(is_file_ ? Followed(path) : path),
      temporary_(TemporaryName(WorkingDirectory(is_file_, path_), path)) {}

PendingFile::~PendingFile() {
  if (!kept_) ::unlink(temporary_.c_str());
}

absl::Status PendingFile::Commit() {
  if (!is_file_) return CopyInto(path_, 0, temporary_);
  if (absl::Status synced = Sync(temporary_); !synced.ok()) return synced;
  TryKeepMode(path_, temporary_);
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) {
    const int error = errno;
    const absl::Status failed = SystemError("write", path_);
    std::error_code ignored;
    return IsBoundToItsName(error) && fs::is_regular_file(path_, ignored) ? WriteInPlace() : failed;
  }
  kept_ = true;
  TrySyncDirectory(DirectoryOf(path_));
  return absl::OkStatus();
}

absl::Status PendingFile::WriteInPlace() {
  absl::Status written = CopyInto(path_, O_TRUNC | O_NOFOLLOW, temporary_);
  if (written.ok()) written = Sync(path_);
  if (written.ok()) return written;
  kept_ = true;
  return absl::Status(written.code(), absl::StrCat(written.message(), "; the whole is in '", temporary_, "'"));
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

void RemoveTemporaryFiles(const std::string& directory) {
  std::error_code error, ignored;  // a file too many does no harm
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    if (IsTemporaryName(it->path().filename().string())) fs::remove(it->path(), ignored);
  }
}

absl::Status CheckWritable(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return absl::InvalidArgumentError(absl::StrCat(path, ": is a directory"));
  if (fs::exists(path, ignored) && !IsWritable(path)) return SystemError("write", path);
  if (!IsFile(path)) return absl::OkStatus();
  if (const std::string directory = DirectoryOf(Followed(path)); !fs::is_directory(directory, ignored)) {
    return absl::NotFoundError(absl::StrCat(path, ": there is no directory ", directory));
  }
  const PendingFile probe(path);
  const absl::Status made = WriteNewFile(probe.temporary(), "");
  return made.ok() ? made : absl::Status(made.code(), absl::StrCat(path, ": cannot be written: ", made.message()));
}

}  // namespace holdfast
