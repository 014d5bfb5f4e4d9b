// SPDX-License-Identifier: Apache-2.0
// absl::Status <-> what travels: grpc::Status with google.rpc details (BadRequest, QuotaFailure, RetryInfo), which both
// sides of the wire share.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"
#include "google/rpc/status.pb.h"

namespace holdfast {

// Fit to be shown to strangers: texts are cut to a bound and made printable, and those of INTERNAL and UNKNOWN errors,
// which may speak of files and memory, are replaced by a general one (log the original).
google::rpc::Status ToRpcStatus(const absl::Status& status);
// Every error has details, be it only its code and text once more: an error without them is not a server's own.
grpc::Status ToGrpcStatus(const absl::Status& status);

// Of a call that its client did not cancel: the server is gone, or ends. What breaks on the way is not always
// UNAVAILABLE: behind nginx a server that was killed is INTERNAL (RST_STREAM), and a connection that closes in the very
// moment may say CANCELLED.
bool IsLostServer(const grpc::Status& status);

// The inverse; field violations and overload details are found again by FieldViolations() and OverloadDetails().
absl::Status FromRpcStatus(const google::rpc::Status& status);
absl::Status FromGrpcStatus(const grpc::Status& status);

}  // namespace holdfast
