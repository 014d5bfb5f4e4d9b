// SPDX-License-Identifier: Apache-2.0
#include "server/tracing/trace_context.h"

#include <algorithm>
#include <cstdint>
#include <optional>

#include "absl/random/random.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// version "-" trace-id "-" parent-id "-" flags; later versions may go on behind another "-".
constexpr size_t kVersion = 2, kTraceId = 32, kParentId = 16, kFlags = 2;
constexpr size_t kLength = kVersion + 1 + kTraceId + 1 + kParentId + 1 + kFlags;

bool IsHex(absl::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return absl::ascii_isdigit(c) || (c >= 'a' && c <= 'f'); });
}

bool IsId(absl::string_view text) { return IsHex(text) && text.find_first_not_of('0') != absl::string_view::npos; }

// The next 'length' characters, and the "-" behind them.
absl::string_view Take(absl::string_view& text, size_t length) {
  const absl::string_view field = text.substr(0, length);
  text.remove_prefix(std::min(text.size(), length + 1));
  return field;
}

// The caller's span, and no one's own yet.
std::optional<TraceContext> Parse(absl::string_view traceparent) {
  if (traceparent.size() < kLength) return std::nullopt;
  for (const size_t dash : {kVersion, kVersion + 1 + kTraceId, kLength - kFlags - 1}) {
    if (traceparent[dash] != '-') return std::nullopt;
  }
  const bool longer = traceparent.size() > kLength;
  if (longer && traceparent[kLength] != '-') return std::nullopt;
  const absl::string_view version = Take(traceparent, kVersion), trace = Take(traceparent, kTraceId),
                          parent = Take(traceparent, kParentId), flags = Take(traceparent, kFlags);
  if (!IsHex(version) || version == "ff" || (version == "00" && longer)) return std::nullopt;
  if (!IsId(trace) || !IsId(parent) || !IsHex(flags)) return std::nullopt;
  constexpr char kSampled = 1;  // of the last digit's bits
  const char last = flags.back();
  const int bits = absl::ascii_isdigit(last) ? last - '0' : last - 'a' + 10;
  return TraceContext{std::string(trace), "", std::string(parent), (bits & kSampled) != 0};
}

}  // namespace

std::string NewSpanId() {
  absl::BitGen random;
  return absl::StrCat(
      absl::Hex(absl::Uniform<uint64_t>(absl::IntervalClosed, random, 1, UINT64_MAX), absl::kZeroPad16));
}

TraceContext TraceOf(absl::string_view traceparent) {
  TraceContext context =
      Parse(traceparent).value_or(TraceContext{absl::StrCat(NewSpanId(), NewSpanId()), "", "", true});
  context.span_id = NewSpanId();
  return context;
}

}  // namespace holdfast
