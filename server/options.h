// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/access/credentials.h"
#include "server/engine/engine.h"
#include "server/logging.h"

namespace holdfast {

// Everything a server can be told.
struct ServerOptions {
  std::string listen = "[::]:50051";            // host:port of gRPC; port 0: a free one
  std::string metrics_listen = "0.0.0.0:9464";  // host:port of /metrics, /healthz and /readyz; port 0: a free one
  // host:port of the page for browsers and its WebSockets; port 0: a free one. Empty: there is none.
  std::string web_listen;
  // Pages of these origins may open sockets there too, beside the server's own: "https://tracks.example".
  std::vector<std::string> web_origins;
  EngineOptions engine;
  ServerTls tls;  // of gRPC; the other port is for the platform alone
  // Callers are let in whose tokens this file has (see AccessList::Parse). Empty: all are.
  std::string token_file;
  // grpc.health.v1 needs no token. false: it is not there at all, and /readyz tells the same.
  bool open_health = true;
  // Reflection needs no token, and shows the protocol to everybody. Without tokens it is there anyhow.
  bool open_reflection = false;
  // A stream whose configuration has not come after this time is ended, so that strangers cannot pile up silent ones.
  absl::Duration first_message_timeout = absl::Seconds(10);
  // A stream whose client neither sends nor reads for this time is ended, and its points' memory is free again. Longer
  // suits clients that pause; infinite keeps what they hold for ever.
  absl::Duration idle_timeout = absl::Minutes(2);
  // What running sessions have at shutdown to finish by themselves. Keep it below the time after which the platform
  // kills the process.
  absl::Duration grace_period = absl::Seconds(20);
  // Checkpoints are sealed with the keys of this file, and other servers that have them take them up. Empty: with a
  // random key, so that sessions are resumed by this process only.
  std::string checkpoint_keys;
  // Checkpoints that are older are refused; infinite: none are.
  absl::Duration checkpoint_max_age = absl::Hours(24);
  // A client that has been silent for this time is pinged, and dropped when it does not answer. Shorter notices dead
  // peers sooner and costs traffic.
  absl::Duration keepalive_time = absl::Minutes(2);
  // A connection that is older takes no new streams, so that clients come to know new servers; running ones go on.
  absl::Duration max_connection_age = absl::InfiniteDuration();
  // Spans of sessions go to the collector of traces there (see OtlpExporter::Options). Empty: to none.
  std::string otlp_endpoint;
  LogFormat log_format = LogFormat::kText;
  std::string log_level = "info";  // the least that is logged
  std::string port_file;           // the bound ports are written here once the server is ready; empty: nowhere

  absl::Status Validate() const;
};

}  // namespace holdfast
