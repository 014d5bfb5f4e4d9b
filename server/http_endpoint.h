// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

// Serves over plain HTTP: /metrics, /healthz (200 while the process lives) and /readyz (200 while 'ready' says so, else
// 503). Anything else is 404. The functions are called on threads of the endpoint, until it is destroyed.
class HttpEndpoint {
 public:
  struct Handlers {
    std::function<std::string()> metrics;  // in Prometheus' text format
    std::function<bool()> ready;
  };
  // 'address' is host:port; port 0: a free one. Without a host, ":9464", it is every address of IPv4.
  static absl::StatusOr<std::unique_ptr<HttpEndpoint>> Start(const std::string& address, Handlers handlers);
  ~HttpEndpoint();

  int port() const;

 private:
  class Impl;
  explicit HttpEndpoint(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace holdfast
