// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"

namespace holdfast {

// Writes the lines "grpc=PORT" and "metrics=PORT". A reader sees the whole file or none.
absl::Status WritePortFile(const std::string& path, int grpc_port, int metrics_port);

}  // namespace holdfast
