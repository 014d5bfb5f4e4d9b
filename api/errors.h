// SPDX-License-Identifier: Apache-2.0
// Errors that carry more than a text: which field of a request was wrong, and when to come back after an overload.
// They travel as payloads of absl::Status, so that modules without protobuf can make and read them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "api/limits.h"

namespace holdfast {

struct FieldViolation {
  std::string field;        // path of the field, e.g. "config.points[3].x"
  std::string description;  // the value and what was expected
};

// What is wrong with one request, as far as an error names it.
class Violations {
 public:
  void Add(std::string field, std::string description) {
    AddMade([&] { return FieldViolation{std::move(field), std::move(description)}; });
  }
  // For loops: 'make' returns the FieldViolation and is called only if that will be named.
  template <typename Make>
  void AddMade(Make make) {
    if (named_.size() < kMaxFieldViolations) {
      named_.push_back(make());
    } else {
      ++unnamed_;
    }
  }
  void Append(Violations other);
  bool empty() const { return named_.empty() && unnamed_ == 0; }
  // OK when there are none, else INVALID_ARGUMENT.
  absl::Status ToStatus() const;

 private:
  std::vector<FieldViolation> named_;
  int64_t unnamed_ = 0;
};

// INVALID_ARGUMENT naming the first kMaxFieldViolations in its message and counting the others, 'unnamed' ones
// included. REQUIRES: there is a violation.
absl::Status InvalidFieldsError(const std::vector<FieldViolation>& violations, int64_t unnamed = 0);
absl::Status InvalidFieldError(absl::string_view field, absl::string_view description);

// Empty when 'status' carries none.
std::vector<FieldViolation> FieldViolations(const absl::Status& status);

// When a place may be free again. Sessions last seconds to hours; a client that asks this often does no harm.
constexpr absl::Duration kRetryAfter = absl::Seconds(2);

// RESOURCE_EXHAUSTED: the quota 'subject' is used up; the caller may try again after 'retry_after' (zero: never).
absl::Status OverloadError(absl::string_view subject, absl::string_view description, absl::Duration retry_after);

struct Overload {
  std::string subject;
  std::string description;
  absl::Duration retry_after;
};
std::optional<Overload> OverloadDetails(const absl::Status& status);

// Whether 'status' says that something is wrong with the server itself: neither with what a client sent, did or was
// late with, nor a quota used up, nor a server that ends.
bool IsServersFault(const absl::Status& status);

}  // namespace holdfast
