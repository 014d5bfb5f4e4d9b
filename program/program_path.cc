// SPDX-License-Identifier: Apache-2.0
#include "program/program_path.h"

#include <filesystem>
#include <system_error>

namespace holdfast {

std::string ProgramPath() {
  std::error_code unknown;
  const std::filesystem::path path = std::filesystem::read_symlink("/proc/self/exe", unknown);
  return unknown ? std::string() : path.string();
}

}  // namespace holdfast
