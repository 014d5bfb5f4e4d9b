// SPDX-License-Identifier: Apache-2.0
#include "server/watched_file.h"

#include <sys/stat.h>

#include "io/file_io.h"

namespace holdfast {

std::optional<FileStamp> LookAt(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return std::nullopt;
  return FileStamp{found.st_ctim.tv_sec, found.st_ctim.tv_nsec, found.st_size, found.st_ino};
}

absl::StatusOr<std::string> ReadWatched(const std::string& path, absl::string_view what) {
  absl::StatusOr<std::string> text = ReadFile(path, kMaxWatchedFileBytes);
  if (text.ok()) return text;
  return absl::Status(text.status().code(), absl::StrCat(what, ": ", text.status().message()));
}

}  // namespace holdfast
