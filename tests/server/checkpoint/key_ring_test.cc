// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/key_ring.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

std::string Secret(char c, size_t bytes = 32) { return std::string(bytes, c); }
std::string Hex(const std::string& bytes) { return absl::BytesToHexString(bytes); }

TEST(KeyRingTest, HoldsTheKeysOfTheFileTheFirstOneSeals) {
  const std::string bytes = "\xff\xfe\xfd" + Secret('a', 40);
  const auto keys = KeyRing::Parse(absl::StrCat("# of November\n\n new : ", Hex(Secret('n')),
                                                " \r\nold.1:", absl::Base64Escape(bytes),
                                                "\n  web-2:", absl::WebSafeBase64Escape(bytes)));
  ASSERT_THAT(keys, IsOk());
  EXPECT_EQ(keys->sealing().id, "new");
  EXPECT_EQ(keys->sealing().secret, Secret('n'));
  ASSERT_NE(keys->Find("old.1"), nullptr);
  EXPECT_EQ(keys->Find("old.1")->secret, bytes);
  ASSERT_NE(keys->Find("web-2"), nullptr);
  EXPECT_EQ(keys->Find("web-2")->secret, bytes);
  EXPECT_EQ(keys->Find("none"), nullptr);
}

TEST(KeyRingTest, AWrongFileIsToldByLineAndItsSecretsAreNot) {
  const std::string good = absl::StrCat("k:", Hex(Secret('s')), "\n");
  const std::string secret = "c2VjcmV0c2VjcmV0";  // of 12 bytes
  std::string many;
  for (size_t i = 0; i <= KeyRing::kMaxKeys; ++i) absl::StrAppend(&many, "k", i, ":", Hex(Secret('s')), "\n");
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"", "there is no key"},
      {"# nothing\n\n", "there is no key"},
      {good + "\n" + secret + "\n", "line 3: expected id:secret"},
      {":" + Hex(Secret('s')), "line 1: expected id:secret"},
      {"a b:" + Hex(Secret('s')), "line 1: expected id:secret"},
      {Hex(Secret('s')) + ":k", "line 1: expected id:secret"},  // the wrong way round
      {good + "j:", "line 2: expected a secret in hex or Base64 behind the colon"},
      {good + "j:" + secret, "line 2: expected a secret of 32 to 1024 bytes, not of 12"},
      {good + "j:abcd", "line 2: expected a secret of 32 to 1024 bytes, not of 2"},
      {"j:" + Hex(Secret('s', 1025)), "not of 1025"},
      {"j:" + secret + "!?", "line 1: expected a secret in hex or Base64"},
      {good + good, "line 2: expected an id that no line before has"},
      {many, "line 65: expected at most 64 keys"},
  };
  for (const auto& [text, says] : wrong) {
    EXPECT_THAT(KeyRing::Parse(text),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr(says), Not(HasSubstr(secret)), Not(HasSubstr(Hex("ssssssss"))))))
        << text;
  }
}

TEST(KeyRingTest, RandomKeysAreUnlikeEachOther) {
  const auto one = KeyRing::Random();
  const auto other = KeyRing::Random();
  ASSERT_THAT(one, IsOk());
  ASSERT_THAT(other, IsOk());
  EXPECT_THAT(one->sealing().id, StartsWith("random-"));
  EXPECT_LE(one->sealing().id.size(), KeyRing::kMaxIdBytes);
  EXPECT_EQ(one->sealing().secret.size(), KeyRing::kMinSecretBytes);
  EXPECT_NE(one->sealing().id, other->sealing().id);
  EXPECT_NE(one->sealing().secret, other->sealing().secret);
}

}  // namespace
}  // namespace holdfast
