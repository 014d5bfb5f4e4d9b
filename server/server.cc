// SPDX-License-Identifier: Apache-2.0
#include "server/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/limits.h"
#include "proto/grpc_deadline.h"

namespace holdfast {
namespace {

// Beside a frame, or a token, a message holds points; a frame that is a little too large is still refused by name.
constexpr int64_t kMessageSlackBytes = 1 << 20;
constexpr int kWaitingStreams = 32;  // streams without a session yet, beside the sessions
constexpr int kMinClientPingMs = 10'000;
constexpr absl::Duration kCloseTime = absl::Seconds(1);  // for the last bytes and for streams of health watchers

int Milliseconds(absl::Duration duration) {
  return static_cast<int>(
      std::min<int64_t>(absl::ToInt64Milliseconds(duration), std::numeric_limits<int>::max()));  // gRPC's "infinite"
}

TrackService::Options ServiceOptions(const ServerOptions& options) {
  TrackService::Options service;
  service.stream.first_message_timeout = options.first_message_timeout;
  service.stream.idle_timeout = options.idle_timeout;
  service.max_streams = options.engine.max_sessions + kWaitingStreams;
  service.grace_period = options.grace_period;
  return service;
}

void SetChannelArguments(const ServerOptions& options, grpc::ServerBuilder& builder) {
  const int64_t largest = std::max(options.engine.limits.max_frame_bytes, kMaxTokenBytes) + kMessageSlackBytes;
  builder.SetMaxReceiveMessageSize(static_cast<int>(std::min<int64_t>(largest, std::numeric_limits<int>::max())));
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // a port in use is an error
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, Milliseconds(options.keepalive_time));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinClientPingMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, Milliseconds(options.max_connection_age));
}

}  // namespace

Server::Server(const ServerOptions& options, Clock& clock, ServerEvents& events, std::shared_ptr<spdlog::logger> log)
    : service_(ServiceOptions(options), clock, events, std::move(log)) {}

Server::~Server() {
  if (server_ != nullptr) server_->Shutdown(SteadyDeadline(absl::ZeroDuration()));
}

absl::StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options, Clock& clock, ServerEvents& events,
                                                      std::shared_ptr<spdlog::logger> log) {
  std::unique_ptr<Server> server(new Server(options, clock, events, std::move(log)));
  if (absl::Status status = server->Listen(options); !status.ok()) return status;
  return server;
}

absl::Status Server::Listen(const ServerOptions& options) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  SetChannelArguments(options, builder);
  builder.AddListeningPort(options.listen, grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(&service_);
  server_ = builder.BuildAndStart();
  if (server_ == nullptr || port_ == 0) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", options.listen, " for gRPC"));
  }
  SetHealth(false);
  return absl::OkStatus();
}

void Server::SetHealth(bool serving) {
  auto* const health = server_->GetHealthCheckService();
  health->SetServingStatus(serving);
  health->SetServingStatus(v1::PointTracking::service_full_name(), serving);
}

void Server::Serve(Engine& engine) {
  service_.Serve(engine);
  if (lifecycle_.Advance(LifecycleState::kServing)) SetHealth(true);
}

void Server::Drain() {
  lifecycle_.Advance(LifecycleState::kDraining);
  SetHealth(false);
  service_.Drain();
  server_->Shutdown(SteadyDeadline(kCloseTime));
  lifecycle_.Advance(LifecycleState::kStopped);
}

}  // namespace holdfast
