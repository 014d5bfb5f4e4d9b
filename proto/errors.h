// SPDX-License-Identifier: Apache-2.0
// Errors that carry more than a text: which field of a request was wrong, and when to come back after an overload.
// They travel as payloads of absl::Status, so that modules without protobuf can make and read them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace holdfast {

struct FieldViolation {
  std::string field;        // path of the field, e.g. "config.points[3].x"
  std::string description;  // the value and what was expected
};

// INVALID_ARGUMENT naming every violation in its message. REQUIRES: violations is not empty.
absl::Status InvalidFieldsError(const std::vector<FieldViolation>& violations);
absl::Status InvalidFieldError(absl::string_view field, absl::string_view description);

// Empty when 'status' carries none.
std::vector<FieldViolation> FieldViolations(const absl::Status& status);

// RESOURCE_EXHAUSTED: the quota 'subject' is used up; the caller may try again after 'retry_after' (zero: never).
absl::Status OverloadError(absl::string_view subject, absl::string_view description, absl::Duration retry_after);

struct Overload {
  std::string subject;
  std::string description;
  absl::Duration retry_after;
};
std::optional<Overload> OverloadDetails(const absl::Status& status);

}  // namespace holdfast
