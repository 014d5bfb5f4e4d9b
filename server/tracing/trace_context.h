// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

// A stream's place in its caller's trace, in the hexadecimal of W3C Trace Context.
struct TraceContext {
  std::string trace_id;   // 32 digits
  std::string span_id;    // 16 digits: the stream's own
  std::string parent_id;  // 16 digits: the caller's span; empty: the trace begins here
  bool sampled = true;    // the caller records this trace
};

// 'traceparent' is the metadata of that name (W3C Trace Context, level 1). Where it is empty or malformed a new trace
// begins, as that standard asks for; nothing of what was sent is kept then.
TraceContext TraceOf(absl::string_view traceparent);

// 16 digits, not all of them 0.
std::string NewSpanId();

}  // namespace holdfast
