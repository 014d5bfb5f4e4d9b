// SPDX-License-Identifier: Apache-2.0
#include "server/tracing/trace_context.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

using ::testing::MatchesRegex;
using ::testing::Not;

constexpr char kTraceId[] = "4bf92f3577b34da6a3ce929d0e0e4736";

TEST(TraceContextTest, AStreamIsASpanOfItsCallersTrace) {
  const std::string parent = "00f067aa0ba902b7";
  const TraceContext context = TraceOf(absl::StrCat("00-", kTraceId, "-", parent, "-01"));
  EXPECT_EQ(context.trace_id, kTraceId);
  EXPECT_THAT(context.span_id, MatchesRegex("[0-9a-f]{16}"));
  EXPECT_NE(context.span_id, parent);
  EXPECT_EQ(context.parent_id, parent);
  EXPECT_TRUE(context.sampled);
  EXPECT_FALSE(TraceOf(absl::StrCat("00-", kTraceId, "-", parent, "-00")).sampled);
  EXPECT_TRUE(TraceOf(absl::StrCat("00-", kTraceId, "-", parent, "-0b")).sampled);
  EXPECT_FALSE(TraceOf(absl::StrCat("00-", kTraceId, "-", parent, "-0c")).sampled);
  EXPECT_NE(context.span_id, TraceOf(absl::StrCat("00-", kTraceId, "-", parent, "-01")).span_id);
}

TEST(TraceContextTest, LaterVersionsMayGoOn) {
  EXPECT_EQ(TraceOf(absl::StrCat("01-", kTraceId, "-00f067aa0ba902b7-01-more")).trace_id, kTraceId);
  EXPECT_EQ(TraceOf(absl::StrCat("cc-", kTraceId, "-00f067aa0ba902b7-01")).trace_id, kTraceId);
}

TEST(TraceContextTest, WhatIsMalformedBeginsANewTrace) {
  const std::string zeros(32, '0');
  for (const std::string& text :
       {std::string(), std::string("00"), absl::StrCat("00-", kTraceId, "-00f067aa0ba902b7"),
        absl::StrCat("00-", kTraceId, "-00f067aa0ba902b7-01-more"),
        absl::StrCat("ff-", kTraceId, "-00f067aa0ba902b7-01"), absl::StrCat("00-", zeros, "-00f067aa0ba902b7-01"),
        absl::StrCat("00-", kTraceId, "-0000000000000000-01"),
        absl::StrCat("00-4BF92F3577B34DA6A3CE929D0E0E4736-00f067aa0ba902b7-01"),
        absl::StrCat("00_", kTraceId, "-00f067aa0ba902b7-01"), absl::StrCat("00-", kTraceId, "-00f067aa0ba902b7-0x"),
        absl::StrCat("01-", kTraceId, "-00f067aa0ba902b7-01more"), std::string(100000, '-')}) {
    const TraceContext context = TraceOf(text);
    EXPECT_THAT(context.trace_id, MatchesRegex("[0-9a-f]{32}")) << text.substr(0, 80);
    EXPECT_NE(context.trace_id, kTraceId) << text.substr(0, 80);
    EXPECT_EQ(context.parent_id, "") << text.substr(0, 80);
    EXPECT_TRUE(context.sampled) << text.substr(0, 80);
    EXPECT_THAT(context.trace_id, Not(MatchesRegex("0+"))) << text.substr(0, 80);
    EXPECT_NE(context.trace_id, TraceOf(text).trace_id) << text.substr(0, 80);
  }
}

}  // namespace
}  // namespace holdfast
