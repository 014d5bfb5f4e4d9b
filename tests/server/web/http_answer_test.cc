// SPDX-License-Identifier: Apache-2.0
#include "server/web/http_answer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "absl/strings/str_split.h"

namespace holdfast {
namespace {

using ::testing::_;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

const std::vector<PageFile>& Files() {
  static const auto* const files = new std::vector<PageFile>{
      {"/index.html", "<p>", "\"a\""}, {"/app.js", "0123456789", "\"b\"", "0-9"}, {"/clip.mp4", "", "\"c\""}};
  return *files;
}

HttpAnswer Get(absl::string_view path, absl::string_view range = "", absl::string_view etag = "") {
  return AnswerWithFile({"GET", path, range, etag}, Files());
}

TEST(HttpAnswerTest, FilesHaveTheirTypesAndAPolicy) {
  const HttpAnswer page = Get("/");
  EXPECT_EQ(page.code, 200);
  EXPECT_EQ(page.body(), "<p>");
  EXPECT_THAT(page.headers, Contains(Pair("Content-Type", "text/html; charset=utf-8")));
  EXPECT_THAT(page.headers, Contains(Pair("Content-Security-Policy", HasSubstr("default-src 'none'"))));
  EXPECT_THAT(Get("/app.js").headers, Contains(Pair("Content-Type", "text/javascript; charset=utf-8")));
  EXPECT_THAT(Get("/clip.mp4").headers, Contains(Pair("Content-Type", "video/mp4")));
}

// The sources that a directive of a content security policy allows.
std::vector<std::string> Allowed(absl::string_view policy, absl::string_view directive) {
  for (const absl::string_view part : absl::StrSplit(policy, "; ")) {
    std::vector<std::string> words = absl::StrSplit(part, ' ');
    if (words.front() != directive) continue;
    words.erase(words.begin());
    return words;
  }
  return {};
}

TEST(HttpAnswerTest, ThePageMayTalkToItsServerAndToNoOther) {
  const HttpAnswer page = Get("/");
  const auto policy = std::find_if(page.headers.begin(), page.headers.end(),
                                   [](const auto& header) { return header.first == "Content-Security-Policy"; });
  ASSERT_NE(policy, page.headers.end());
  EXPECT_THAT(Allowed(policy->second, "default-src"), ElementsAre("'none'"));
  EXPECT_THAT(Allowed(policy->second, "connect-src"), ElementsAre("'self'"));
}

TEST(HttpAnswerTest, OnlyWhatIsThereIsServed) {
  for (const std::string path : {"/app", "/app.js/", "/../app.js", "//app.js", "", "app.js", "/APP.JS"}) {
    EXPECT_EQ(Get(path).code, 404) << path;
  }
  EXPECT_EQ(AnswerWithFile({"POST", "/", "", ""}, Files()).code, 405);
  EXPECT_EQ(AnswerWithFile({"HEAD", "/", "", ""}, Files()).code, 200);
}

TEST(HttpAnswerTest, WhatABrowserHasIsNotSentAgain) {
  EXPECT_EQ(Get("/app.js", "", "\"b\"").code, 304);
  EXPECT_EQ(Get("/app.js", "", "\"b\"").body(), "");
  EXPECT_EQ(Get("/app.js", "", "\"a\"").code, 200);
}

TEST(HttpAnswerTest, AFileIsCompressedForWhoTakesThat) {
  for (const std::string codings : {"gzip", "gzip, deflate, br", "br;q=1.0, GZIP ; q=0.5"}) {
    const HttpAnswer answer = AnswerWithFile({"GET", "/app.js", "", "", codings}, Files());
    EXPECT_EQ(answer.body(), "0-9") << codings;
    EXPECT_THAT(answer.headers, Contains(Pair("Content-Encoding", "gzip")));
    EXPECT_THAT(answer.headers, Contains(Pair("Vary", "Accept-Encoding")));
    EXPECT_THAT(answer.headers, Contains(Pair("ETag", "\"b-gzip\"")));
  }
  for (const std::string codings : {"", "br", "gzip;q=0", "gzip; q=0.0", "gzip;q=", "x-gzip", "*"}) {
    const HttpAnswer answer = AnswerWithFile({"GET", "/app.js", "", "", codings}, Files());
    EXPECT_EQ(answer.body(), "0123456789") << codings;
    EXPECT_THAT(answer.headers, Not(Contains(Pair("Content-Encoding", _))));
    EXPECT_THAT(answer.headers, Contains(Pair("Vary", "Accept-Encoding")));
  }
  EXPECT_EQ(AnswerWithFile({"GET", "/", "", "", "gzip"}, Files()).body(), "<p>") << "there is nothing else";
  EXPECT_EQ(AnswerWithFile({"GET", "/app.js", "", "\"b-gzip\"", "gzip"}, Files()).code, 304);
  EXPECT_EQ(AnswerWithFile({"GET", "/app.js", "bytes=2-4", "", "gzip"}, Files()).body(), "234")
      << "of the file as it is";
}

TEST(HttpAnswerTest, ALargeAnswerMayTakeLonger) {
  EXPECT_EQ(TimeToTake(0), std::chrono::seconds(10));
  EXPECT_EQ(TimeToTake(size_t{1} << 20), std::chrono::seconds(10 + 128));
}

TEST(HttpAnswerTest, RangesOfAFile) {
  const struct {
    const char* range;
    const char* body;
    const char* said;
  } kCases[] = {{"bytes=0-0", "0", "bytes 0-0/10"},   {"bytes=2-4", "234", "bytes 2-4/10"},
                {"bytes=7-", "789", "bytes 7-9/10"},  {"bytes=-2", "89", "bytes 8-9/10"},
                {"bytes=8-99", "89", "bytes 8-9/10"}, {"bytes=-99", "0123456789", "bytes 0-9/10"}};
  for (const auto& it : kCases) {
    const HttpAnswer answer = Get("/app.js", it.range);
    EXPECT_EQ(answer.code, 206) << it.range;
    EXPECT_EQ(answer.body(), it.body) << it.range;
    EXPECT_THAT(answer.headers, Contains(Pair("Content-Range", it.said)));
  }
}

TEST(HttpAnswerTest, RangesThatAreNone) {
  for (const std::string range : {"bytes=10-", "bytes=4-2", "bytes=-0", "bytes=-", "bytes=a-b", "bytes=1-2,4-5", "1-2",
                                  "bytes=18446744073709551616-", "bytes=--1"}) {
    const HttpAnswer answer = Get("/app.js", range);
    EXPECT_EQ(answer.code, 416) << range;
    EXPECT_THAT(answer.headers, Contains(Pair("Content-Range", "bytes */10"))) << range;
  }
  EXPECT_EQ(Get("/clip.mp4", "bytes=0-").code, 416);  // of an empty file
}

}  // namespace
}  // namespace holdfast
