// SPDX-License-Identifier: Apache-2.0
#include "proto/errors.h"

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

}  // namespace

absl::Status InvalidFieldsError(const std::vector<FieldViolation>& violations) {
  json list = json::array();
  for (const FieldViolation& v : violations) list.push_back({{"field", v.field}, {"description", v.description}});
  absl::Status status =
      absl::InvalidArgumentError(absl::StrJoin(violations, "; ", [](std::string* out, const FieldViolation& v) {
        absl::StrAppend(out, v.field, ": ", v.description);
      }));
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

}  // namespace holdfast
