// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"

namespace holdfast {

// Where a file is made before it gets its name: in the same directory and with the same suffix as 'path'.
std::string TemporaryName(const std::string& path);

// Lets 'write' make the file under a temporary name, then gives it its own; on an error nothing is left behind and a
// file that had the name before is untouched.
absl::Status WriteAtomically(const std::string& path, const std::function<absl::Status(const std::string&)>& write);

// OK where a file can be made beside 'path' and take its name; makes one and removes it.
absl::Status CheckWritable(const std::string& path);

}  // namespace holdfast
