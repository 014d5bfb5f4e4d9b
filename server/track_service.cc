// SPDX-License-Identifier: Apache-2.0
#include "server/track_service.h"

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"
#include "proto/grpc_status.h"
#include "server/tracing/trace_context.h"
#include "server/track_reactor.h"

namespace holdfast {
namespace {

constexpr char kAuthorization[] = "authorization";
constexpr char kTraceParent[] = "traceparent";

// Empty where there is none; the first one of several.
absl::string_view MetadataOf(const grpc::CallbackServerContext& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  if (found == context.client_metadata().end()) return "";
  return {found->second.data(), found->second.size()};
}

}  // namespace

TrackService::TrackService(ServedStreams& streams) : streams_(streams) {
  AddCall("/holdfast.v1.PointTracking/Track", [this](auto* context) { return Track(context); });
  AddCall("/holdfast.v1.PointTracking/GetServerInfo", [this](auto* context) { return GetServerInfo(*context); });
}

UnreadService::Reactor* TrackService::Track(grpc::CallbackServerContext* context) {
  TrackReactor* reactor = nullptr;
  const auto make = [&](ServedStream::Deps deps, Gatekeeper::Pass pass, int max_points) {
    auto made =
        std::make_unique<TrackReactor>(std::move(deps), std::move(pass), TraceOf(MetadataOf(*context, kTraceParent)),
                                       max_points, context, [this](TrackReactor* done) { streams_.Retire(done); });
    reactor = made.get();
    return std::unique_ptr<LiveStream>(std::move(made));
  };
  const std::string peer = context->peer();
  const auto opened = streams_.Open({MetadataOf(*context, kAuthorization), peer}, "grpc", make);
  if (!opened.ok()) return new RefusedCall(ToGrpcStatus(opened.status()));
  return reactor;
}

UnreadService::Reactor* TrackService::GetServerInfo(const grpc::CallbackServerContext& context) {
  const std::string peer = context.peer();
  const auto info = streams_.Info({MetadataOf(context, kAuthorization), peer});
  if (!info.ok()) return new RefusedCall(ToGrpcStatus(info.status()));
  const grpc::Slice bytes(info->SerializeAsString());
  return new AnsweredCall(grpc::ByteBuffer(&bytes, 1));
}

}  // namespace holdfast
