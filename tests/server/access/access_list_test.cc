// SPDX-License-Identifier: Apache-2.0
#include "server/access/access_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsNull;
using ::testing::Not;

constexpr char kAnnesToken[] = "q1w2e3r4t5z6u7i8";
constexpr char kBobsToken[] = "Zm9vYmFyLWZvb2Jhcg==";

TEST(AccessListTest, KnowsWhoseATokenIsAndWhatIsTheirs) {
  const auto list = AccessList::Parse(absl::StrCat("# who may come\n\nanne:", kAnnesToken, "\r\n  bob@lab:", kBobsToken,
                                                   "\tmax_points=500  max_sessions=2 \n"));
  ASSERT_THAT(list, IsOk());
  EXPECT_EQ(list->size(), 2u);
  const Grant* const anne = list->Find(kAnnesToken);
  ASSERT_NE(anne, nullptr);
  EXPECT_EQ(anne->name, "anne");
  EXPECT_EQ(anne->max_sessions, 0);
  EXPECT_EQ(anne->max_points, 0);
  const Grant* const bob = list->Find(kBobsToken);
  ASSERT_NE(bob, nullptr);
  EXPECT_EQ(bob->name, "bob@lab");
  EXPECT_EQ(bob->max_sessions, 2);
  EXPECT_EQ(bob->max_points, 500);
}

TEST(AccessListTest, WhatIsNearlyATokenIsNone) {
  const auto list = AccessList::Parse(absl::StrCat("anne:", kAnnesToken));
  ASSERT_THAT(list, IsOk());
  const std::string token = kAnnesToken;
  for (const std::string& other : {std::string(), token.substr(1), token + "8", token.substr(0, 15) + "9",
                                   std::string("anne"), "anne:" + token, token + std::string(1, '\0')}) {
    EXPECT_THAT(list->Find(other), IsNull()) << other;
  }
}

TEST(AccessListTest, NamesTheLineThatIsWrongAndQuotesNothing) {
  const std::string good = absl::StrCat("anne:", kAnnesToken, "\n");
  for (const char* line :
       {"bob", ":secretsecretsecret", "bob:", "bob:secretsecret", "b b:secretsecretsecret",
        "bob:secretsecretsecret max_points=0", "bob:secretsecretsecret max_points=many",
        "bob:secretsecretsecret colour=1", "bob:secretsecret\xc3\xa4secret", "anne:secretsecretsecret"}) {
    EXPECT_THAT(AccessList::Parse(good + line), StatusIs(absl::StatusCode::kInvalidArgument,
                                                         AllOf(HasSubstr("line 2"), Not(HasSubstr("secretsecret")))))
        << line;
  }
  EXPECT_THAT(AccessList::Parse(absl::StrCat(good, "bob:", kAnnesToken)),
              StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr("line 2"), Not(HasSubstr(kAnnesToken)))));
}

TEST(AccessListTest, AnEmptyListIsAMistake) {
  EXPECT_THAT(AccessList::Parse("# nobody\n"), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no name")));
}

TEST(AccessListTest, HasAnEnd) {
  std::string text;
  for (size_t i = 0; i < AccessList::kMaxNames; ++i) absl::StrAppend(&text, "n", i, ":token-of-number-", i, "\n");
  EXPECT_THAT(AccessList::Parse(text), IsOk());
  EXPECT_THAT(AccessList::Parse(absl::StrCat(text, "anne:", kAnnesToken)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at most 1000")));
}

}  // namespace
}  // namespace holdfast
