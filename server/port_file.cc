// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"

namespace holdfast {

absl::Status PreparePortFile(const std::string& path) {
  RemovePortFile(path);
  return CheckWritable(path);
}

void RemovePortFile(const std::string& path) {
  std::error_code gone;
  const std::filesystem::path file = std::filesystem::canonical(path, gone);  // a link to it stays
  if (!gone && std::filesystem::is_regular_file(file, gone)) std::filesystem::remove(file, gone);
}

absl::Status WritePortFile(const std::string& path, const std::vector<std::pair<std::string, int>>& ports) {
  std::string lines;
  for (const auto& [name, port] : ports) {
    if (port != 0) absl::StrAppend(&lines, name, "=", port, "\n");
  }
  return WriteFileAtomically(path, lines);
}

}  // namespace holdfast
