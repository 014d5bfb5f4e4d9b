// SPDX-License-Identifier: Apache-2.0
#include "client/remote_tracker.h"

#include <grpcpp/grpcpp.h>

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "client/remote_stream.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "proto/convert.h"
#include "proto/grpc_deadline.h"
#include "proto/grpc_status.h"

namespace holdfast {
namespace {

constexpr int kFirstBackoffMs = 100;  // a server that is just starting is found soon
constexpr int kMaxBackoffMs = 1000;

std::shared_ptr<grpc::Channel> MakeChannel(const RemoteTracker::Options& options) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(options.max_receive_bytes);
  arguments.SetMaxSendMessageSize(-1);  // the server's limit counts
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, static_cast<int>(absl::ToInt64Milliseconds(options.keepalive_time)));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS,
                   static_cast<int>(absl::ToInt64Milliseconds(options.keepalive_timeout)));
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kFirstBackoffMs);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kMaxBackoffMs);
  return grpc::CreateCustomChannel(options.address, grpc::InsecureChannelCredentials(), arguments);
}

grpc::Status AskInfo(const std::shared_ptr<grpc::Channel>& channel, absl::Duration timeout,
                     v1::GetServerInfoResponse* response) {
  grpc::ClientContext context;
  context.set_deadline(SteadyDeadline(timeout));
  return v1::PointTracking::NewStub(channel)->GetServerInfo(&context, v1::GetServerInfoRequest(), response);
}

// A channel does not tell why it failed to connect, a call that does not wait for it does.
absl::Status WhyNotConnected(const std::shared_ptr<grpc::Channel>& channel, absl::string_view address) {
  v1::GetServerInfoResponse ignored;
  const grpc::Status status = AskInfo(channel, absl::Seconds(1), &ignored);
  if (status.ok()) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("holdfast: server at ", address, " cannot be reached: ", status.error_message()));
}

}  // namespace

absl::Status RemoteTracker::Options::Validate() const {
  if (!absl::StrContains(address, ':')) {
    return InvalidFieldError("address", absl::StrCat("is \"", address, "\", expected host:port"));
  }
  if (connect_timeout <= absl::ZeroDuration()) return InvalidFieldError("connect_timeout", "expected more than zero");
  if (answer_timeout <= absl::ZeroDuration()) return InvalidFieldError("answer_timeout", "expected more than zero");
  if (max_receive_bytes <= 0) return InvalidFieldError("max_receive_bytes", "expected more than zero");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RemoteTracker>> RemoteTracker::Connect(const Options& options) {
  const absl::Status valid = options.Validate();
  if (!valid.ok()) return valid;
  std::shared_ptr<grpc::Channel> channel = MakeChannel(options);
  if (!channel->WaitForConnected(SteadyDeadline(options.connect_timeout))) {
    const absl::Status reason = WhyNotConnected(channel, options.address);
    if (!reason.ok()) return reason;
  }
  return std::unique_ptr<RemoteTracker>(new RemoteTracker(options, std::move(channel)));
}

RemoteTracker::RemoteTracker(const Options& options, std::shared_ptr<grpc::Channel> channel)
    : options_(options), channel_(std::move(channel)) {}

RemoteTracker::~RemoteTracker() = default;

absl::StatusOr<std::unique_ptr<TrackStream>> RemoteTracker::Open(const SessionConfig& config, TrackObserver& observer) {
  auto stream = std::make_unique<RemoteStream>(channel_, options_.address, observer);
  const absl::Status started = stream->Start(config, options_.answer_timeout);
  if (!started.ok()) return started;
  return std::unique_ptr<TrackStream>(std::move(stream));
}

absl::StatusOr<TrackerInfo> RemoteTracker::Info() {
  v1::GetServerInfoResponse response;
  const grpc::Status status = AskInfo(channel_, options_.answer_timeout, &response);
  if (!status.ok()) return AboutServer(options_.address, FromGrpcStatus(status));
  absl::StatusOr<TrackerInfo> info = FromProto(response);
  return info.ok() ? info : AboutServer(options_.address, info.status());
}

}  // namespace holdfast
