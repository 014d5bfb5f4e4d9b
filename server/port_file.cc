// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include <cstdio>
#include <fstream>

#include "absl/strings/str_cat.h"

namespace holdfast {

absl::Status WritePortFile(const std::string& path, int grpc_port, int metrics_port) {
  const std::string part = path + ".part";
  std::ofstream file(part, std::ios::trunc);
  file << "grpc=" << grpc_port << "\nmetrics=" << metrics_port << "\n";
  file.close();
  if (!file || std::rename(part.c_str(), path.c_str()) != 0) {
    return absl::UnavailableError(absl::StrCat("cannot write the port file ", path));
  }
  return absl::OkStatus();
}

}  // namespace holdfast
