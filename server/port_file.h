// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"

namespace holdfast {

// Takes away what an earlier run has left, which would be read for this one's. An error where the file cannot be
// written.
absl::Status PreparePortFile(const std::string& path);

// Leaves alone what is no file, as a pipe.
void RemovePortFile(const std::string& path);

// Writes a line NAME=PORT for each port that is not 0. A reader sees the whole file or none.
absl::Status WritePortFile(const std::string& path, const std::vector<std::pair<std::string, int>>& ports);

}  // namespace holdfast
