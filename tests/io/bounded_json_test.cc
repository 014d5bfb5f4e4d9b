// SPDX-License-Identifier: Apache-2.0
#include "io/bounded_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <string>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Lt;
using ::testing::SizeIs;
using Json = nlohmann::json;

std::string Repeated(const std::string& piece, int times) {
  std::string text;
  for (int i = 0; i < times; ++i) text += piece;
  return text;
}

TEST(BoundedJsonTest, ReadsEveryKindOfValue) {
  const auto json = ParseBoundedJson(R"( {"a": [1, -2, 2.5, "x\u00e9", null, true], "b": {"c": []}} )", {});
  ASSERT_THAT(json, IsOk());
  const Json want = {{"a", {1, -2, 2.5, "x\xc3\xa9", nullptr, true}}, {"b", {{"c", Json::array()}}}};
  EXPECT_EQ(*json, want);
}

TEST(BoundedJsonTest, TheSizeIsBoundedBeforeAnythingIsRead) {
  EXPECT_THAT(ParseBoundedJson("[1]", {3, 4}), IsOk());
  EXPECT_THAT(ParseBoundedJson("[1]", {2, 4}), StatusIs(kInvalid, HasSubstr("3 bytes; at most 2")));
  EXPECT_THAT(ParseBoundedJson("]]]]", {3, 4}), StatusIs(kInvalid, HasSubstr("4 bytes"))) << "not a syntax error";
}

TEST(BoundedJsonTest, ObjectsAndArraysWithinOneAnotherAreCounted) {
  EXPECT_THAT(ParseBoundedJson("1", {64, 0}), IsOk());
  EXPECT_THAT(ParseBoundedJson("[]", {64, 0}), StatusIs(kInvalid, HasSubstr("nested deeper than 0")));
  EXPECT_THAT(ParseBoundedJson(R"([[1]])", {64, 2}), IsOk());
  EXPECT_THAT(ParseBoundedJson(R"({"a": [{}]})", {64, 3}), IsOk());
  EXPECT_THAT(ParseBoundedJson(R"({"a": [{}]})", {64, 2}), StatusIs(kInvalid, HasSubstr("nested deeper than 2")));
  EXPECT_THAT(ParseBoundedJson(R"([[], [], {}, {"a": 1}, []])", {64, 2}), IsOk()) << "those that are closed";
}

// The end of neither text is there: who read on would call it a syntax error.
TEST(BoundedJsonTest, AMillionBracketsAreRefusedAtTheFirstOneTooMany) {
  const JsonLimits limits{size_t{16} << 20, 4};
  EXPECT_THAT(ParseBoundedJson(std::string(1000000, '['), limits), StatusIs(kInvalid, HasSubstr("deeper than 4")));
  EXPECT_THAT(ParseBoundedJson(Repeated("{\"a\":", 1000000), limits), StatusIs(kInvalid, HasSubstr("deeper than 4")));
}

TEST(BoundedJsonTest, AKeyStandsOnceInItsObject) {
  EXPECT_THAT(ParseBoundedJson(R"({"a": 1, "a": 1})", {}), StatusIs(kInvalid, HasSubstr("key 'a' stands twice")));
  EXPECT_THAT(ParseBoundedJson(R"({"a": 1, "\u0061": 2})", {}), StatusIs(kInvalid, HasSubstr("'a'"))) << "unescaped";
  EXPECT_THAT(ParseBoundedJson(R"([{"b": {"a": {}, "c": {}, "a": {}}}])", {}), StatusIs(kInvalid, HasSubstr("'a'")));
  EXPECT_THAT(ParseBoundedJson(R"({"a": {"a": 1}, "b": [{"a": 1}, {"a": 2}]})", {}), IsOk()) << "other objects' keys";
}

TEST(BoundedJsonTest, AKeyIsQuotedInAShortAndPrintableWay) {
  const std::string wild = R"("\u001b[31m\u0007)" + std::string(5000, 'k') + R"(": 1)";
  const absl::Status status = ParseBoundedJson("{" + wild + "," + wild + "}", {}).status();
  EXPECT_THAT(status, StatusIs(kInvalid, HasSubstr("\\x1b[31m\\x07kkk")));
  EXPECT_THAT(status.message(), SizeIs(Lt(600u)));
}

TEST(BoundedJsonTest, WhatIsNotJsonIsRefused) {
  for (const char* text :
       {"", " ", "nul", "[1,]", "{\"a\" 1}", "{a: 1}", "['a']", "[1] 2", "[01]", "[1.]", "[+1]", "[NaN]", "[Infinity]",
        "[\"\n\"]", "[\"\\x41\"]", "[\"\\ud800\"]", "[\"\xc3\x28\"]", "\xff\xfe[", "[/* 1 */]"}) {
    EXPECT_THAT(ParseBoundedJson(text, {}), StatusIs(kInvalid, HasSubstr("syntax error at byte"))) << text;
  }
}

TEST(BoundedJsonTest, AZeroByteDoesNotHideWhatFollows) {
  for (const char* after : {"", "]", "{\"b\": 2}"}) {
    const std::string text = "{\"a\": 1}" + std::string(1, '\0') + after;
    EXPECT_THAT(ParseBoundedJson(text, {}), StatusIs(kInvalid, HasSubstr("syntax error at byte 9"))) << after;
  }
}

TEST(BoundedJsonTest, TextThatIsCutAnywhereIsRefused) {
  const std::string whole = R"({"a": [1, {"b": "c\n"}], "d": true})";
  ASSERT_THAT(ParseBoundedJson(whole, {}), IsOk());
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_THAT(ParseBoundedJson(whole.substr(0, length), {}), StatusIs(kInvalid)) << length;
  }
}

TEST(BoundedJsonTest, NumbersAreExactAsLongAsTheyAreWholeAndNeverInfinite) {
  const auto json = ParseBoundedJson("[18446744073709551615, -9223372036854775808, 18446744073709551616]", {});
  ASSERT_THAT(json, IsOk());
  EXPECT_EQ((*json)[0], std::numeric_limits<uint64_t>::max());
  EXPECT_EQ((*json)[1], std::numeric_limits<int64_t>::min());
  EXPECT_TRUE((*json)[2].is_number_float()) << "it does not wrap around";
  EXPECT_THAT(ParseBoundedJson("[1e999]", {}), StatusIs(kInvalid));
  EXPECT_THAT(ParseBoundedJson("[-" + std::string(5000, '9') + "]", {}), StatusIs(kInvalid));
}

}  // namespace
}  // namespace holdfast
