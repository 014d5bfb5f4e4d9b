// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"

namespace holdfast {

// Writes a copy of the checkpoint at 'from' to 'to' (which may be the same file) whose metadata says 'value' under
// 'key'; tensors and the rest of the metadata are as they were. Errors name the file.
absl::Status CopyWithMetadata(const std::string& from, const std::string& to, const std::string& key,
                              const std::string& value);

}  // namespace holdfast
