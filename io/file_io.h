// SPDX-License-Identifier: Apache-2.0
// Whole files in, and what identifies them.
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

// SHA-256 in lower-case hex.
std::string Sha256Hex(absl::string_view bytes);

}  // namespace holdfast
