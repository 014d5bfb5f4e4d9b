// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_spool.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {

FrameSpool::FrameSpool(std::string directory, int fd)
    : directory_(std::move(directory)), file_(std::make_unique<Descriptor>(fd)) {}

absl::StatusOr<FrameSpool> FrameSpool::Create() {
  const char* chosen = std::getenv("TMPDIR");
  const std::string directory = chosen == nullptr || *chosen == '\0' ? "/var/tmp" : chosen;
  std::string path = absl::StrCat(directory, "/holdfast-frames-XXXXXX");
  const int fd = mkostemp(path.data(), O_CLOEXEC);
  if (fd < 0) return SystemError("keep frames (see TMPDIR) in", directory);
  unlink(path.c_str());
  return FrameSpool(directory, fd);
}

absl::Status FrameSpool::Append(absl::string_view bytes) {
  int64_t at = ends_.empty() ? 0 : ends_.back();
  while (!bytes.empty()) {
    const ssize_t written = pwrite(file_->get(), bytes.data(), bytes.size(), at);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return SystemError("keep frames (see TMPDIR) in", directory_);
    bytes.remove_prefix(static_cast<size_t>(written));
    at += written;
  }
  ends_.push_back(at);
  return absl::OkStatus();
}

absl::StatusOr<std::string> FrameSpool::Read(int64_t index) const {
  const int64_t begin = index == 0 ? 0 : ends_[index - 1];
  std::string bytes(static_cast<size_t>(ends_[index] - begin), '\0');
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t got =
        pread(file_->get(), bytes.data() + done, bytes.size() - done, begin + static_cast<int64_t>(done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return SystemError("read frames again from", directory_);
    done += static_cast<size_t>(got);
  }
  return bytes;
}

}  // namespace holdfast
