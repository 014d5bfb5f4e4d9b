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

// Ends a call that was not admitted.
class RefusedCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  explicit RefusedCall(const absl::Status& status) { Finish(ToGrpcStatus(status)); }
  void OnDone() override { delete this; }  // owned by the call
};

// Empty where there is none; the first one of several.
absl::string_view MetadataOf(const grpc::CallbackServerContext& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  if (found == context.client_metadata().end()) return "";
  return {found->second.data(), found->second.size()};
}

}  // namespace

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* TrackService::Track(grpc::CallbackServerContext* context) {
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
  if (!opened.ok()) return new RefusedCall(opened.status());
  return reactor;
}

grpc::ServerUnaryReactor* TrackService::GetServerInfo(grpc::CallbackServerContext* context,
                                                      const v1::GetServerInfoRequest*,
                                                      v1::GetServerInfoResponse* response) {
  grpc::ServerUnaryReactor* const reactor = context->DefaultReactor();
  const std::string peer = context->peer();
  absl::StatusOr<v1::GetServerInfoResponse> info = streams_.Info({MetadataOf(*context, kAuthorization), peer});
  const absl::Status status = info.status();
  if (status.ok()) *response = *std::move(info);
  reactor->Finish(ToGrpcStatus(status));
  return reactor;
}

}  // namespace holdfast
