// SPDX-License-Identifier: Apache-2.0
#include "client/remote_call.h"

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "proto/grpc_status.h"

namespace holdfast {

grpc::ClientContext* Introduced(const RemoteServer& server, grpc::ClientContext& context) {
  if (!server.token.empty()) context.AddMetadata("authorization", absl::StrCat("Bearer ", server.token));
  if (!server.trace_parent.empty()) context.AddMetadata("traceparent", server.trace_parent);
  return &context;
}

absl::Status WithText(const absl::Status& status, absl::string_view text) {
  absl::Status changed(status.code(), text);
  status.ForEachPayload([&changed](absl::string_view url, const absl::Cord& cord) { changed.SetPayload(url, cord); });
  return changed;
}

absl::Status AboutServer(absl::string_view address, const absl::Status& status, absl::string_view where) {
  if (status.ok()) return status;
  const bool unavailable = status.code() == absl::StatusCode::kUnavailable;
  return WithText(status, absl::StrCat("holdfast: server at ", address, unavailable ? " is unavailable: " : ": ",
                                       status.message(), where));
}

absl::Status RemoteCall::Finish() {
  v1::TrackResponse unread;
  while (call_->Read(&unread)) {
  }
  const grpc::Status status = call_->Finish();
  return IsLostServer(status) ? absl::UnavailableError(status.error_message()) : FromGrpcStatus(status);
}

}  // namespace holdfast
