// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace holdfast {

// Asks the server on this machine whose HTTP endpoint listens on 'metrics_listen' (host:port) for /readyz: what an
// image without a shell has for its health. UNAVAILABLE with the reason when it is not there, does not answer within
// 'timeout' or is not ready; INVALID_ARGUMENT for an address without a port of its own.
absl::Status CheckHealth(const std::string& metrics_listen, absl::Duration timeout);

}  // namespace holdfast
