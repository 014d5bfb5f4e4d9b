// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/engine/engine.h"

namespace holdfast {

enum class LogFormat { kText, kJson };

// Everything a server can be told. The engine checks its own part when it is created.
struct ServerOptions {
  std::string listen = "[::]:50051";            // gRPC; port 0: a free one
  std::string metrics_listen = "0.0.0.0:9464";  // HTTP; port 0: a free one
  EngineOptions engine;
  absl::Duration first_message_timeout = absl::Seconds(10);  // from the start of a stream to its config
  absl::Duration idle_timeout = absl::Minutes(2);            // of a stream whose client neither sends nor reads
  absl::Duration grace_period = absl::Seconds(20);           // at shutdown, for sessions to finish by themselves
  absl::Duration keepalive_time = absl::Minutes(2);          // between pings to a silent client
  absl::Duration max_connection_age = absl::InfiniteDuration();
  LogFormat log_format = LogFormat::kText;
  std::string log_level = "info";
  std::string port_file;  // written once the server is ready; empty: none

  absl::Status Validate() const;
};

}  // namespace holdfast
