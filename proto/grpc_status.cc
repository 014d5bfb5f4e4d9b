// SPDX-License-Identifier: Apache-2.0
#include "proto/grpc_status.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "api/errors.h"
#include "google/rpc/error_details.pb.h"
#include "proto/convert_values.h"

namespace holdfast {
namespace {

// Trailing metadata is limited to 8 KiB in all by most peers, and details travel in base64.
constexpr size_t kMaxMessage = 512;
constexpr size_t kMaxText = kMaxViolationText + 3;  // with the dots of what was cut before

// Printable ASCII only: protobuf strings must be UTF-8, and a client's bytes come back in error texts.
std::string Safe(absl::string_view text, size_t limit) {
  std::string safe(text.substr(0, limit));
  std::replace_if(
      safe.begin(), safe.end(), [](unsigned char c) { return c < 0x20 || c > 0x7e; }, '?');
  if (text.size() > limit) absl::StrAppend(&safe, "...");
  return safe;
}

std::string PublicMessage(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInternal:
      return "internal error; the server's log says more";
    case absl::StatusCode::kUnknown:
      return "unknown error; the server's log says more";
    default:
      return Safe(status.message(), kMaxMessage);
  }
}

void AddBadRequest(const std::vector<FieldViolation>& violations, google::rpc::Status& out) {
  if (violations.empty()) return;
  google::rpc::BadRequest bad_request;
  for (size_t i = 0; i < std::min(violations.size(), kMaxFieldViolations); ++i) {
    auto* violation = bad_request.add_field_violations();
    violation->set_field(Safe(violations[i].field, kMaxText));
    violation->set_description(Safe(violations[i].description, kMaxText));
  }
  out.add_details()->PackFrom(bad_request);
}

void AddOverload(const Overload& overload, google::rpc::Status& out) {
  google::rpc::QuotaFailure quota;
  auto* violation = quota.add_violations();
  violation->set_subject(Safe(overload.subject, kMaxText));
  violation->set_description(Safe(overload.description, kMaxText));
  out.add_details()->PackFrom(quota);
  if (overload.retry_after <= absl::ZeroDuration()) return;  // trying again is of no use
  google::rpc::RetryInfo retry;
  internal::DurationToProto(absl::Trunc(overload.retry_after, absl::Milliseconds(1)), retry.mutable_retry_delay());
  out.add_details()->PackFrom(retry);
}

// What the details of 'in' say; 'message' is kept as the server wrote it.
absl::Status WithDetails(const google::rpc::Status& in, absl::Status status) {
  std::vector<FieldViolation> violations;
  Overload overload;
  bool overloaded = false;
  for (const auto& any : in.details()) {
    google::rpc::BadRequest bad_request;
    google::rpc::QuotaFailure quota;
    google::rpc::RetryInfo retry;
    if (any.UnpackTo(&bad_request)) {
      for (const auto& v : bad_request.field_violations()) violations.push_back({v.field(), v.description()});
    } else if (any.UnpackTo(&quota) && quota.violations_size() > 0) {
      overloaded = true;
      overload.subject = quota.violations(0).subject();
      overload.description = quota.violations(0).description();
    } else if (any.UnpackTo(&retry)) {
      overload.retry_after = internal::DurationFromProto(retry.retry_delay());
    }
  }
  const auto adopt = [&status](const absl::Status& source) {
    source.ForEachPayload([&status](absl::string_view url, const absl::Cord& cord) { status.SetPayload(url, cord); });
  };
  if (!violations.empty()) adopt(InvalidFieldsError(violations));
  if (overloaded) adopt(OverloadError(overload.subject, overload.description, overload.retry_after));
  return status;
}

}  // namespace

google::rpc::Status ToRpcStatus(const absl::Status& status) {
  google::rpc::Status out;
  out.set_code(static_cast<int>(status.code()));
  if (status.ok()) return out;
  out.set_message(PublicMessage(status));
  AddBadRequest(FieldViolations(status), out);
  if (const auto overload = OverloadDetails(status)) AddOverload(*overload, out);
  return out;
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const google::rpc::Status rpc = ToRpcStatus(status);
  return grpc::Status(static_cast<grpc::StatusCode>(rpc.code()), rpc.message(), rpc.SerializeAsString());
}

absl::Status FromRpcStatus(const google::rpc::Status& status) {
  if (status.code() == 0) return absl::OkStatus();
  return WithDetails(status, absl::Status(static_cast<absl::StatusCode>(status.code()), status.message()));
}

bool IsLostServer(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::UNAVAILABLE:
      return true;
    case grpc::StatusCode::CANCELLED:
    case grpc::StatusCode::INTERNAL:
    case grpc::StatusCode::UNKNOWN:
      return status.error_details().empty();
    default:
      return false;
  }
}

absl::Status FromGrpcStatus(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  google::rpc::Status rpc;
  if (!rpc.ParseFromString(status.error_details())) rpc.Clear();
  return WithDetails(rpc, absl::Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message()));
}

}  // namespace holdfast
