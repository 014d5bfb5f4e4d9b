// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "server/engine/engine.h"
#include "server/options.h"
#include "server/prometheus_metrics.h"
#include "server/server.h"
#include "tests/support/simulated_clock.h"

namespace holdfast {

// The real server in this process, on a free port of the loopback device, over any engine.
class TestServer {
 public:
  // Null 'engine': it stays in kLoading until server().Serve. 'engine' must outlive the test server.
  explicit TestServer(Engine* engine);
  TestServer(Engine* engine, ServerOptions options);

  Server& server() { return *server_; }
  PrometheusMetrics& metrics() { return metrics_; }
  SimulatedClock& clock() { return clock_; }  // of timeouts and drain; stands still
  std::string address() const;
  std::shared_ptr<grpc::Channel> NewChannel() const;  // a connection of its own

 private:
  SimulatedClock clock_;
  PrometheusMetrics metrics_;
  std::unique_ptr<Server> server_;
};

}  // namespace holdfast
