// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"

namespace holdfast {

absl::Status WritePortFile(const std::string& path, int grpc_port, int metrics_port) {
  return WriteFileAtomically(path, absl::StrCat("grpc=", grpc_port, "\nmetrics=", metrics_port, "\n"));
}

}  // namespace holdfast
