// SPDX-License-Identifier: Apache-2.0
#include "io/file_io.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "io/descriptor.h"

namespace holdfast {
namespace {

// False with errno set, or with errno 0 when the file ends early.
bool ReadAll(int fd, std::string& bytes) {
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::read(fd, bytes.data() + done, bytes.size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got == 0) errno = 0;
    if (got <= 0) return false;
    done += static_cast<size_t>(got);
  }
  return true;
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes) {
  // Not blocking: opening a pipe that nobody writes would wait for ever.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.valid()) return SystemError("open", path);
  struct stat info = {};
  if (::fstat(file.get(), &info) != 0) return SystemError("examine", path);
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat("'", path, "' is not a regular file"));
  if (info.st_size > max_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat("'", path, "' has ", info.st_size, " bytes; at most ", max_bytes));
  }
  std::string bytes(static_cast<size_t>(info.st_size), '\0');
  if (!ReadAll(file.get(), bytes)) {
    if (errno == 0) return absl::AbortedError(absl::StrCat("'", path, "' became shorter while it was read"));
    return SystemError("read", path);
  }
  return bytes;
}

std::string Sha256Hex(absl::string_view bytes) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  const int done = EVP_Digest(bytes.data(), bytes.size(), digest, &size, EVP_sha256(), nullptr);
  assert(done == 1);  // fails only where the library has no SHA-256 at all
  static_cast<void>(done);
  return absl::BytesToHexString(absl::string_view(reinterpret_cast<const char*>(digest), size));
}

}  // namespace holdfast
