// SPDX-License-Identifier: Apache-2.0
#include "api/errors.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

using nlohmann::json;

constexpr char kFieldsPayload[] = "holdfast/field-violations";
constexpr char kOverloadPayload[] = "holdfast/overload";

// Texts may quote a caller's bytes, which need not be UTF-8.
std::string Dump(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

json Payload(const absl::Status& status, absl::string_view url) {
  const auto payload = status.GetPayload(url);
  return payload ? json::parse(std::string(*payload), nullptr, /*allow_exceptions=*/false) : json();
}

std::string Shortened(absl::string_view text) {
  if (text.size() <= kMaxViolationText) return std::string(text);
  return absl::StrCat(text.substr(0, kMaxViolationText), "...");
}

}  // namespace

void Violations::Append(Violations other) {
  for (FieldViolation& v : other.named_) Add(std::move(v.field), std::move(v.description));
  unnamed_ += other.unnamed_;
}

absl::Status Violations::ToStatus() const { return empty() ? absl::OkStatus() : InvalidFieldsError(named_, unnamed_); }

absl::Status InvalidFieldsError(const std::vector<FieldViolation>& violations, int64_t unnamed) {
  const size_t named = std::min(violations.size(), kMaxFieldViolations);
  json list = json::array();
  std::vector<std::string> texts;
  for (size_t i = 0; i < named; ++i) {
    const std::string field = Shortened(violations[i].field), description = Shortened(violations[i].description);
    texts.push_back(absl::StrCat(field, ": ", description));
    list.push_back({{"field", field}, {"description", description}});
  }
  if (const int64_t more = static_cast<int64_t>(violations.size() - named) + unnamed; more > 0) {
    texts.push_back(absl::StrCat("and ", more, " more"));
  }
  absl::Status status = absl::InvalidArgumentError(absl::StrJoin(texts, "; "));
  status.SetPayload(kFieldsPayload, absl::Cord(Dump(list)));
  return status;
}

absl::Status InvalidFieldError(absl::string_view field, absl::string_view description) {
  return InvalidFieldsError({{std::string(field), std::string(description)}});
}

std::vector<FieldViolation> FieldViolations(const absl::Status& status) {
  std::vector<FieldViolation> violations;
  for (const json& v : Payload(status, kFieldsPayload)) {
    violations.push_back({v.value("field", ""), v.value("description", "")});
  }
  return violations;
}

absl::Status OverloadError(absl::string_view subject, absl::string_view description, absl::Duration retry_after) {
  absl::Status status = absl::ResourceExhaustedError(absl::StrCat(subject, ": ", description));
  status.SetPayload(kOverloadPayload, absl::Cord(Dump({{"subject", std::string(subject)},
                                                       {"description", std::string(description)},
                                                       {"retry_ms", absl::ToInt64Milliseconds(retry_after)}})));
  return status;
}

std::optional<Overload> OverloadDetails(const absl::Status& status) {
  const json payload = Payload(status, kOverloadPayload);
  if (!payload.is_object()) return std::nullopt;
  return Overload{payload.value("subject", ""), payload.value("description", ""),
                  absl::Milliseconds(payload.value("retry_ms", int64_t{0}))};
}

bool IsServersFault(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
    case absl::StatusCode::kCancelled:
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kUnauthenticated:
    case absl::StatusCode::kUnavailable:
      return false;
    default:  // RESOURCE_EXHAUSTED without a quota is memory that the machine does not have
      return !OverloadDetails(status).has_value();
  }
}

}  // namespace holdfast
