// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "http/http_server.h"

namespace holdfast {

// Serves over plain HTTP: /metrics, /healthz (200 while the process lives) and /readyz (200 while 'ready' says so, else
// 503). Anything else is 404. The functions are called on a thread of the server, until it is destroyed; 'metrics' is
// in Prometheus' text format. 'address' is host:port; port 0: a free one.
absl::StatusOr<std::unique_ptr<HttpServer>> StartHttpEndpoint(const std::string& address,
                                                              std::function<std::string()> metrics,
                                                              std::function<bool()> ready);

}  // namespace holdfast
