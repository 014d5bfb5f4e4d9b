// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace holdfast {

// A piece of work that is over, as tracing has it.
struct Span {
  std::string trace_id;  // as those of TraceContext
  std::string span_id;
  std::string parent_id;  // empty: the trace begins here
  std::string name;
  absl::Time begin;
  absl::Time end;
  absl::Status status;
  std::vector<std::pair<std::string, std::string>> texts;  // attributes
  std::vector<std::pair<std::string, int64_t>> numbers;    // attributes
};

// Takes spans to where they are looked at. Implementations are thread-safe and quick: they drop what they have no room
// for.
class SpanSink {
 public:
  virtual ~SpanSink() = default;
  virtual void Take(Span span) = 0;
};

}  // namespace holdfast
