// SPDX-License-Identifier: Apache-2.0
#include "client/remote_call.h"

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "proto/grpc_status.h"

namespace holdfast {

absl::Status AboutServer(absl::string_view address, const absl::Status& status, absl::string_view where) {
  if (status.ok()) return status;
  const bool unavailable = status.code() == absl::StatusCode::kUnavailable;
  absl::Status named(status.code(), absl::StrCat("holdfast: server at ", address,
                                                 unavailable ? " is unavailable: " : ": ", status.message(), where));
  status.ForEachPayload([&named](absl::string_view url, const absl::Cord& cord) { named.SetPayload(url, cord); });
  return named;
}

absl::Status RemoteCall::Finish() {
  v1::TrackResponse unread;
  while (call_->Read(&unread)) {
  }
  return FromGrpcStatus(call_->Finish());
}

}  // namespace holdfast
