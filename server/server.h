// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/server.h>
#include <spdlog/logger.h>

#include <memory>

#include "absl/status/statusor.h"
#include "api/clock.h"
#include "server/access/gatekeeper.h"
#include "server/engine/engine.h"
#include "server/events.h"
#include "server/health_service.h"
#include "server/lifecycle.h"
#include "server/options.h"
#include "server/streams/served_streams.h"
#include "server/tracing/span.h"
#include "server/track_service.h"
#include "server/web/web_server.h"

namespace holdfast {

// The network's side: PointTracking, grpc.health.v1 and reflection on the port of gRPC, and the one for browsers.
// Listens from the start, so that probes get an answer while the model loads, and walks through the Lifecycle; health
// is SERVING in kServing alone.
class Server {
 public:
  // 'clock' and 'events' must outlive the server.
  static absl::StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options, Clock& clock, ServerEvents& events,
                                                       std::shared_ptr<spdlog::logger> log);
  // Cuts off streams that still run.
  ~Server();

  // kLoading -> kServing. 'engine' must outlive the server.
  void Serve(Engine& engine);
  // -> kDraining -> kStopped: lets running sessions finish within the grace period, ends the others, and closes the
  // port. Blocks until all that is done. Call it once.
  void Drain();

  LifecycleState state() const { return lifecycle_.state(); }
  int port() const { return port_; }
  int web_port() const { return web_ == nullptr ? 0 : web_->port(); }  // 0: there is none

 private:
  Server(const ServerOptions& options, std::unique_ptr<Gatekeeper> gatekeeper, std::unique_ptr<SpanSink> spans,
         Clock& clock, ServerEvents& events, std::shared_ptr<spdlog::logger> log);
  absl::Status Listen(const ServerOptions& options);
  absl::Status ListenToBrowsers(const ServerOptions& options);

  Lifecycle lifecycle_;
  int port_ = 0;
  const std::unique_ptr<Gatekeeper> gatekeeper_;
  const std::unique_ptr<SpanSink> spans_;  // null: traces are not recorded
  const std::shared_ptr<spdlog::logger> log_;
  ServedStreams streams_;
  TrackService service_;
  HealthService health_;
  std::unique_ptr<WebServer> web_;        // null: browsers are not served
  std::unique_ptr<grpc::Server> server_;  // last: it uses the services
};

}  // namespace holdfast
