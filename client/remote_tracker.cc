// SPDX-License-Identifier: Apache-2.0
#include "client/remote_tracker.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "api/address.h"
#include "api/errors.h"
#include "client/remote_call.h"
#include "client/resuming_stream.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "proto/convert.h"
#include "proto/grpc_deadline.h"
#include "proto/grpc_status.h"

namespace holdfast {
namespace {

constexpr int kFirstBackoffMs = 100;  // a server that is just starting is found soon
constexpr int kMaxBackoffMs = 1000;
constexpr int kNameLookupMs = 2000;  // at most so often: a server that is replaced has another address
// Of one attempt to connect: with encryption, a distant server's takes several round trips.
constexpr absl::Duration kLeastAttempt = absl::Seconds(2);
constexpr absl::Duration kLongestAttempt = absl::Seconds(10);
// Of a URI that names several servers: sessions go round those that say that they take some.
constexpr char kSpread[] = R"({"loadBalancingConfig": [{"round_robin": {}}],
                               "healthCheckConfig": {"serviceName": "holdfast.v1.PointTracking"}})";

bool NamesSeveral(const std::string& address) {
  return absl::StartsWith(address, "dns:") || absl::StartsWith(address, "ipv4:") || absl::StartsWith(address, "ipv6:");
}

// Whether nothing that is sent there leaves this machine, of the addresses of a URI all.
bool StaysHere(absl::string_view address) {
  if (!absl::ConsumePrefix(&address, "ipv4:")) absl::ConsumePrefix(&address, "ipv6:");
  const std::vector<absl::string_view> each = absl::StrSplit(address, ',');
  return std::all_of(each.begin(), each.end(), IsLoopback);
}

// An attempt at an address that swallows what it is sent leaves time for two more, at a host's next addresses.
absl::Duration AttemptTime(const RemoteTracker::Options& options) {
  return std::clamp(options.connect_timeout / 3, kLeastAttempt, kLongestAttempt);
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const RemoteTracker::Options& options) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(options.max_receive_bytes);
  arguments.SetMaxSendMessageSize(-1);                      // the server's limit counts
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // each tracker has connections of its own
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, ArgumentMilliseconds(options.keepalive_time));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, ArgumentMilliseconds(options.keepalive_timeout));
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // any number: gRPC stops asking after two otherwise
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, ArgumentMilliseconds(AttemptTime(options)));  // its name hides it
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kMaxBackoffMs);
  arguments.SetInt(GRPC_ARG_DNS_MIN_TIME_BETWEEN_RESOLUTIONS_MS, kNameLookupMs);
  arguments.SetInt(GRPC_ARG_SERVICE_CONFIG_DISABLE_RESOLUTION, 1);  // a name server has no say in what follows
  if (NamesSeveral(address)) arguments.SetServiceConfigJSON(kSpread);
  if (StaysHere(address)) arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);  // the environment's is for other machines
  if (!options.tls.server_name.empty()) arguments.SetSslTargetNameOverride(options.tls.server_name);
  return grpc::CreateCustomChannel(address, MakeChannelCredentials(options.tls), arguments);
}

grpc::Status AskInfo(const RemoteServer& server, absl::Duration timeout, v1::GetServerInfoResponse* response) {
  grpc::ClientContext context;
  context.set_deadline(SteadyDeadline(timeout));
  const auto stub = v1::PointTracking::NewStub(server.channel);
  return stub->GetServerInfo(Introduced(server, context), v1::GetServerInfoRequest(), response);
}

// A channel does not tell why it failed to connect, a call that does not wait for it does, unless an attempt is still
// under way.
absl::Status WhyNotConnected(const RemoteServer& server, absl::Duration waited) {
  v1::GetServerInfoResponse ignored;
  const grpc::Status status = AskInfo(server, absl::Seconds(1), &ignored);
  if (status.ok()) return absl::OkStatus();
  const bool silent = status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
  return absl::UnavailableError(absl::StrCat(
      "holdfast: server at ", server.address, " cannot be reached: ",
      silent ? absl::StrCat("no connection within ", absl::FormatDuration(waited)) : status.error_message()));
}

// 'once': gives up when an attempt has failed at all of the server's addresses, which may be before 'timeout'.
absl::Status ConnectTo(const RemoteServer& server, absl::Duration timeout, bool once) {
  const gpr_timespec deadline = SteadyDeadline(timeout);
  for (grpc_connectivity_state state; (state = server.channel->GetState(true)) != GRPC_CHANNEL_READY;) {
    if (once && state == GRPC_CHANNEL_TRANSIENT_FAILURE) return WhyNotConnected(server, timeout);
    if (!server.channel->WaitForStateChange(state, deadline)) return WhyNotConnected(server, timeout);
  }
  return absl::OkStatus();
}

// The first that answers. One that does not may be starting, which is waited for when no other one answers either.
absl::StatusOr<size_t> ConnectToAny(const std::vector<RemoteServer>& servers, absl::Duration timeout) {
  std::vector<std::string> reasons;
  for (const bool once : {true, false}) {
    reasons.clear();
    for (size_t i = 0; i < servers.size() && (!once || servers.size() > 1); ++i) {
      const absl::Status connected = ConnectTo(servers[i], timeout, once);
      if (connected.ok()) return i;
      reasons.emplace_back(connected.message());
    }
  }
  return absl::UnavailableError(absl::StrJoin(reasons, "; "));
}

// One address, or a URI of several.
bool IsAddress(const std::string& address) {
  const std::vector<absl::string_view> each = absl::StrSplit(address, ',');
  return absl::StrContains(address, ':') && std::none_of(each.begin(), each.end(), PortIsTooLarge) &&
         std::none_of(address.begin(), address.end(), absl::ascii_isspace);
}

absl::Status CheckAddresses(const std::vector<std::string>& addresses) {
  if (addresses.empty()) return InvalidFieldError("addresses", "are missing, expected host:port");
  for (const std::string& address : addresses) {
    if (IsAddress(address)) continue;
    return InvalidFieldError("addresses", absl::StrCat("hold \"", address, "\", expected host:port"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status RemoteTracker::Options::Validate() const {
  if (absl::Status status = CheckAddresses(addresses); !status.ok()) return status;
  if (absl::Status status = tls.Validate(); !status.ok()) return status;
  if (absl::Status status = CheckToken(token); !status.ok()) return status;
  if (!std::all_of(trace_parent.begin(), trace_parent.end(), absl::ascii_isgraph)) {
    return InvalidFieldError("trace_parent", "expected visible ASCII characters, as W3C Trace Context has it");
  }
  if (connect_timeout <= absl::ZeroDuration()) return InvalidFieldError("connect_timeout", "expected more than zero");
  if (answer_timeout <= absl::ZeroDuration()) return InvalidFieldError("answer_timeout", "expected more than zero");
  if (max_receive_bytes <= 0) return InvalidFieldError("max_receive_bytes", "expected more than zero");
  if (buffer_bytes <= 0) return InvalidFieldError("buffer_bytes", "expected more than zero");
  if (checkpoint_interval_frames <= 0) {
    return InvalidFieldError("checkpoint_interval_frames", "expected more than zero");
  }
  if (reconnect_timeout < absl::ZeroDuration()) return InvalidFieldError("reconnect_timeout", "expected zero or more");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RemoteTracker>> RemoteTracker::Connect(const Options& options) {
  const absl::Status valid = options.Validate();
  if (!valid.ok()) return valid;
  std::vector<RemoteServer> servers;
  for (const std::string& address : options.addresses) {
    servers.push_back({address, MakeChannel(address, options), options.token, options.trace_parent});
  }
  const absl::StatusOr<size_t> first = ConnectToAny(servers, options.connect_timeout);
  if (!first.ok()) return first.status();
  return std::unique_ptr<RemoteTracker>(new RemoteTracker(options, std::move(servers), *first));
}

RemoteTracker::RemoteTracker(const Options& options, std::vector<RemoteServer> servers, size_t first_server)
    : options_(options), servers_(std::move(servers)), first_server_(first_server) {}

RemoteTracker::~RemoteTracker() = default;

absl::StatusOr<std::unique_ptr<TrackStream>> RemoteTracker::Open(const SessionConfig& config, TrackObserver& observer) {
  SessionConfig wanted = config;
  if (options_.resume && wanted.checkpoint_interval_frames == 0) {
    wanted.checkpoint_interval_frames = options_.checkpoint_interval_frames;
  }
  auto stream = std::make_unique<ResumingStream>(
      ResumingStream::Options{servers_, first_server_, options_.answer_timeout, options_.resume, options_.buffer_bytes,
                              options_.reconnect_timeout, options_.backoff},
      wanted, observer);
  const absl::Status answer = stream->AwaitAnswer();
  if (!answer.ok()) return answer;
  return std::unique_ptr<TrackStream>(std::move(stream));
}

absl::StatusOr<TrackerInfo> RemoteTracker::Info() {
  absl::StatusOr<TrackerInfo> info;
  for (size_t i = 0; i < servers_.size(); ++i) {
    const RemoteServer& server = servers_[(first_server_ + i) % servers_.size()];
    v1::GetServerInfoResponse response;
    const grpc::Status status = AskInfo(server, options_.answer_timeout, &response);
    info = status.ok() ? FromProto(response) : absl::StatusOr<TrackerInfo>(FromGrpcStatus(status));
    if (info.ok()) return info;
    info = AboutServer(server.address, info.status());
    if (!absl::IsUnavailable(info.status())) break;
  }
  return info;
}

}  // namespace holdfast
