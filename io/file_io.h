// SPDX-License-Identifier: Apache-2.0
// Whole files in, whole files out.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// The bytes of a regular file. RESOURCE_EXHAUSTED when it is larger than 'max_bytes', found before memory is taken;
// NOT_FOUND, PERMISSION_DENIED... as the system says.
absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes);

// Atomic: written beside 'path', fsynced, renamed (the directory fsynced too); mode 0644 less the umask. On an error
// 'path' is what it was and nothing else is left behind.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes);

// SHA-256 in lower-case hex.
std::string Sha256Hex(absl::string_view bytes);

}  // namespace holdfast
