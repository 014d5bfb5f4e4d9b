// SPDX-License-Identifier: Apache-2.0
#include "io/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace holdfast {

namespace fs = std::filesystem;

std::string TemporaryName(const std::string& path) {
  fs::path temporary(path);
  const std::string suffix = temporary.extension().string();
  temporary.replace_filename(absl::StrCat(".", temporary.stem().string(), ".", getpid(), suffix));
  return temporary.string();
}

absl::Status WriteAtomically(const std::string& path, const std::function<absl::Status(const std::string&)>& write) {
  const std::string temporary = TemporaryName(path);
  std::error_code error;
  absl::Status status = write(temporary);
  if (status.ok()) fs::rename(temporary, path, error);
  if (error) status = absl::InternalError(error.message());
  if (status.ok()) return status;
  fs::remove(temporary, error);
  return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
}

absl::Status CheckWritable(const std::string& path) {
  const fs::path directory = fs::path(path).parent_path();
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return absl::InvalidArgumentError(absl::StrCat(path, ": is a directory"));
  if (!directory.empty() && !fs::is_directory(directory, ignored)) {
    return absl::NotFoundError(absl::StrCat(path, ": there is no directory ", directory.string()));
  }
  const std::string temporary = TemporaryName(path);
  const int file = open(temporary.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0) return absl::PermissionDeniedError(absl::StrCat(path, ": cannot be written: ", std::strerror(errno)));
  close(file);
  fs::remove(temporary, ignored);
  return absl::OkStatus();
}

}  // namespace holdfast
