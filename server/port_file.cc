// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"

namespace holdfast {

absl::Status WritePortFile(const std::string& path, const std::vector<std::pair<std::string, int>>& ports) {
  std::string lines;
  for (const auto& [name, port] : ports) {
    if (port != 0) absl::StrAppend(&lines, name, "=", port, "\n");
  }
  return WriteFileAtomically(path, lines);
}

}  // namespace holdfast
