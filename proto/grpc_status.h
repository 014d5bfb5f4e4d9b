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
grpc::Status ToGrpcStatus(const absl::Status& status);

// The inverse; field violations and overload details are found again by FieldViolations() and OverloadDetails().
absl::Status FromRpcStatus(const google::rpc::Status& status);
absl::Status FromGrpcStatus(const grpc::Status& status);

}  // namespace holdfast
