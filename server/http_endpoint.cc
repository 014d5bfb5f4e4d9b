// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <utility>

namespace holdfast {

absl::StatusOr<std::unique_ptr<HttpServer>> StartHttpEndpoint(const std::string& address,
                                                              std::function<std::string()> metrics,
                                                              std::function<bool()> ready) {
  return HttpServer::Start(address, {{"/metrics", [metrics = std::move(metrics)] { return MetricsPage(metrics()); }},
                                     {"/healthz", [] { return TextPage(200, "ok\n"); }},
                                     {"/readyz", [ready = std::move(ready)] {
                                        return ready() ? TextPage(200, "ready\n") : TextPage(503, "not ready\n");
                                      }}});
}

}  // namespace holdfast
