// SPDX-License-Identifier: Apache-2.0
#include "server/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/resource_quota.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "api/address.h"
#include "api/limits.h"
#include "proto/grpc_deadline.h"
#include "server/tracing/otlp_exporter.h"

namespace holdfast {
namespace {

// Beside a frame, or a token, a message holds points; a frame that is a little too large is still refused by name.
constexpr int64_t kMessageSlackBytes = 1 << 20;
constexpr int kWaitingStreams = 32;   // streams without a session yet, beside the sessions
constexpr int kRefusedStreams = 100;  // of one connection, on their way out
constexpr int64_t kConnectionBytes = 64 << 20;
constexpr int kUnreadBytes = 4 << 20;  // of a stream: 40 MB/s over a round trip of 100 ms
constexpr int kMinClientPingMs = 10'000;
constexpr absl::Duration kCloseTime = absl::Seconds(1);  // for the last bytes and for streams of health watchers

int MostStreams(const ServerOptions& options) { return options.engine.max_sessions + kWaitingStreams; }

ServedStreams::Options StreamsOptions(const ServerOptions& options, SpanSink* spans) {
  ServedStreams::Options service;
  service.stream.first_message_timeout = options.first_message_timeout;
  service.stream.idle_timeout = options.idle_timeout;
  service.max_streams = MostStreams(options);
  service.grace_period = options.grace_period;
  service.spans = spans;
  return service;
}

int64_t LargestMessage(const ServerOptions& options) {
  return std::min<int64_t>(std::max(options.engine.limits.max_frame_bytes, kMaxTokenBytes) + kMessageSlackBytes,
                           std::numeric_limits<int>::max());
}

// What gRPC holds at once: a message of each stream. It takes a message in to its end, up to 4 GiB, before it refuses
// it for its size; beyond the quota it ends streams instead, whosever they are. What comes for a stream that is not
// read has an end of its own, which gRPC would otherwise set by what the line carries.
void LimitMemory(const ServerOptions& options, grpc::ServerBuilder& builder) {
  grpc::ResourceQuota quota("holdfast");
  quota.Resize(static_cast<size_t>(MostStreams(options) * LargestMessage(options) + kConnectionBytes));
  builder.SetResourceQuota(quota);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, kUnreadBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                             MostStreams(options) + HealthService::kMaxWatchers + kRefusedStreams);
}

void SetChannelArguments(const ServerOptions& options, grpc::ServerBuilder& builder) {
  builder.SetMaxReceiveMessageSize(static_cast<int>(LargestMessage(options)));
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);  // a port in use is an error
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, ArgumentMilliseconds(options.keepalive_time));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // any number: gRPC stops after two otherwise
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinClientPingMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, ArgumentMilliseconds(options.max_connection_age));
}

// Takes reflection away from one server: the library gives it to every one of the process.
class WithoutReflection final : public grpc::ServerBuilderOption {
 public:
  void UpdateArguments(grpc::ChannelArguments*) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    const auto is_reflection = [](const auto& plugin) { return plugin->name() == "proto_server_reflection"; };
    plugins->erase(std::remove_if(plugins->begin(), plugins->end(), is_reflection), plugins->end());
  }
};

absl::StatusOr<std::unique_ptr<SpanSink>> MakeSpanSink(const std::string& endpoint, ServerEvents& events,
                                                       const std::shared_ptr<spdlog::logger>& log) {
  if (endpoint.empty()) return std::unique_ptr<SpanSink>();
  OtlpExporter::Options options;
  options.endpoint = endpoint;
  return OtlpExporter::Create(options, events, log);
}

void WarnOfPlainText(const ServerOptions& options, spdlog::logger& log) {
  if (!options.tls.enabled() && !IsLoopback(options.listen)) {
    log.warn(absl::StrCat("gRPC on ", options.listen, " is plain text: frames, results and tokens can be read on the ",
                          "way; see --tls_cert"));
  }
  if (!options.web_listen.empty() && !IsLoopback(options.web_listen)) {
    log.warn(absl::StrCat("the page for browsers on ", options.web_listen, " is plain text, and browsers give it no ",
                          "camera; let a proxy that speaks TLS stand before it"));
  }
}

}  // namespace

Server::Server(const ServerOptions& options, std::unique_ptr<Gatekeeper> gatekeeper, std::unique_ptr<SpanSink> spans,
               Clock& clock, ServerEvents& events, std::shared_ptr<spdlog::logger> log)
    : gatekeeper_(std::move(gatekeeper)),
      spans_(std::move(spans)),
      log_(std::move(log)),
      streams_(StreamsOptions(options, spans_.get()), *gatekeeper_, clock, events, log_),
      service_(streams_) {}

Server::~Server() {
  if (server_ != nullptr) server_->Shutdown(SteadyDeadline(absl::ZeroDuration()));
  streams_.Abort();
}

absl::StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options, Clock& clock, ServerEvents& events,
                                                      std::shared_ptr<spdlog::logger> log) {
  auto gatekeeper = Gatekeeper::Create(options.token_file, clock, log);
  if (!gatekeeper.ok()) return gatekeeper.status();
  auto spans = MakeSpanSink(options.otlp_endpoint, events, log);
  if (!spans.ok()) return spans.status();
  WarnOfPlainText(options, *log);
  std::unique_ptr<Server> server(
      new Server(options, *std::move(gatekeeper), *std::move(spans), clock, events, std::move(log)));
  if (absl::Status status = server->Listen(options); !status.ok()) return status;
  if (absl::Status status = server->ListenToBrowsers(options); !status.ok()) return status;
  return server;
}

absl::Status Server::ListenToBrowsers(const ServerOptions& options) {
  if (options.web_listen.empty()) return absl::OkStatus();
  WebOptions web;
  web.listen = options.web_listen;
  web.origins = options.web_origins;
  web.max_message_bytes = LargestMessage(options);
  web.keepalive_time = options.keepalive_time;
  auto started = WebServer::Start(web, streams_, log_);
  if (!started.ok()) return started.status();
  web_ = *std::move(started);
  return absl::OkStatus();
}

absl::Status Server::Listen(const ServerOptions& options) {
  const auto credentials = MakeServerCredentials(options.tls);
  if (!credentials.ok()) return credentials.status();
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  const bool reflects = options.token_file.empty() || options.open_reflection;
  if (!reflects) builder.SetOption(std::make_unique<WithoutReflection>());
  SetChannelArguments(options, builder);
  LimitMemory(options, builder);
  builder.AddListeningPort(options.listen, *credentials, &port_);
  builder.RegisterService(&service_);
  if (options.open_health) builder.RegisterService(&health_);
  server_ = builder.BuildAndStart();
  if (server_ == nullptr || port_ == 0) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", options.listen, " for gRPC"));
  }
  return absl::OkStatus();
}

void Server::Serve(Engine& engine) {
  streams_.Serve(engine);
  if (lifecycle_.Advance(LifecycleState::kServing)) health_.Set(true);
}

void Server::Drain() {
  lifecycle_.Advance(LifecycleState::kDraining);
  health_.Set(false);
  streams_.Drain();
  server_->Shutdown(SteadyDeadline(kCloseTime));
  lifecycle_.Advance(LifecycleState::kStopped);
}

}  // namespace holdfast
