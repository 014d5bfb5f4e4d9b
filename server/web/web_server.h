// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/streams/served_streams.h"

namespace holdfast {

struct WebOptions {
  std::string listen;                // host:port; port 0: a free one
  std::vector<std::string> origins;  // see HostRules
  int64_t max_message_bytes = 0;     // of a client; larger ones end the connection
  int max_connections = 256;         // open at once; further ones are closed
  // A socket that has been silent for half of this time is pinged, and dropped when it does not answer.
  absl::Duration keepalive_time = absl::Minutes(2);
};

// The browsers' way in: the page at /, what the server runs at /v1/info, and Track streams over WebSockets at
// /v1/track, subprotocol "holdfast.v1", a message of the protocol each. A token comes as the subprotocol
// "bearer.BASE64URL", as pages cannot set headers, or as of gRPC's clients. One thread serves all connections.
class WebServer {
 public:
  // 'streams' must outlive the server.
  static absl::StatusOr<std::unique_ptr<WebServer>> Start(const WebOptions& options, ServedStreams& streams,
                                                          std::shared_ptr<spdlog::logger> log);
  // REQUIRES: no stream of its is open any more.
  ~WebServer();

  int port() const;

 private:
  class Impl;
  explicit WebServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace holdfast
