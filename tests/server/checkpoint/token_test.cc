// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/token.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <array>
#include <random>
#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "tests/support/mutate.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;

const absl::Time kNow = absl::FromUnixSeconds(1'800'000'000);

KeyRing Keys(const std::string& id, char secret) {
  return *KeyRing::Parse(absl::StrCat(id, ":", absl::BytesToHexString(std::string(32, secret))));
}

// As SealToken would, of whatever a header and a body say.
std::string Signed(std::string token, const SealingKey& key) {
  std::array<unsigned char, 32> hmac{};
  HMAC(EVP_sha256(), key.secret.data(), static_cast<int>(key.secret.size()),
       reinterpret_cast<const unsigned char*>(token.data()), token.size(), hmac.data(), nullptr);
  return token.append(hmac.begin(), hmac.end());
}

class TokenTest : public ::testing::Test {
 protected:
  absl::Status Open(absl::string_view token) const { return OpenToken(token, keys_, absl::InfinitePast()).status(); }

  const KeyRing keys_ = Keys("key", 's');
  const std::string content_ = "what a session says, what a session says";
  const std::string token_ = *SealToken(content_, keys_.sealing(), kNow);
  // Of the token's parts.
  const size_t size_at_ = 4 + 1 + 1 + 3 + 8;
  const size_t body_at_ = size_at_ + 8;
};

TEST_F(TokenTest, GivesBackWhatItHolds) {
  EXPECT_THAT(OpenToken(token_, keys_, kNow), IsOkAndHolds(content_));
  EXPECT_LT(token_.size(), body_at_ + content_.size() + 32);  // compressed
  const std::string large(1'000'000, '\0');
  EXPECT_THAT(OpenToken(*SealToken(large, keys_.sealing(), kNow), keys_, kNow), IsOkAndHolds(large));
}

TEST_F(TokenTest, IsRefusedWhicheverBitIsAnother) {
  for (size_t at = 0; at < token_.size(); ++at) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string token = token_;
      token[at] = static_cast<char>(token[at] ^ (1 << bit));
      EXPECT_THAT(Open(token), StatusIs(kPrecondition)) << at << " " << bit;
    }
  }
}

TEST_F(TokenTest, IsRefusedAtWhicheverLengthItIsCutOff) {
  for (size_t length = 0; length < token_.size(); ++length) {
    EXPECT_THAT(Open(token_.substr(0, length)), StatusIs(kPrecondition, HasSubstr(length < 4 ? "no token" : "cut off")))
        << length;
  }
  EXPECT_THAT(Open(token_ + "x"), StatusIs(kPrecondition, HasSubstr("tampered")));
}

TEST_F(TokenTest, SaysWhatIsWrong) {
  EXPECT_THAT(Open("a token of somebody else"), StatusIs(kPrecondition, HasSubstr("is no token")));
  std::string token = token_;
  token[4] = 2;
  EXPECT_THAT(Open(token), StatusIs(kPrecondition, HasSubstr("has version 2")));
  token = token_;
  token[body_at_ + 3] ^= 1;
  EXPECT_THAT(Open(token), StatusIs(kPrecondition, HasSubstr("was tampered with")));
  EXPECT_THAT(OpenToken(token_, Keys("key", 't'), kNow).status(), StatusIs(kPrecondition, HasSubstr("another secret")));
  EXPECT_THAT(OpenToken(token_, Keys("other", 's'), kNow).status(),
              StatusIs(kPrecondition, HasSubstr("by a server with other keys: this one has no key 'key'")));
  EXPECT_THAT(OpenToken(token_, keys_, kNow + absl::Seconds(1)).status(),
              StatusIs(kPrecondition, HasSubstr("too old: it was made at 2027-01-15T08:00:00+00:00")));
}

TEST_F(TokenTest, EveryKeyOfTheRingOpens) {
  const auto rotated = KeyRing::Parse(absl::StrCat("new:", absl::BytesToHexString(std::string(32, 'n')),
                                                   "\nkey:", absl::BytesToHexString(std::string(32, 's'))));
  ASSERT_THAT(rotated, IsOk());
  EXPECT_THAT(OpenToken(token_, *rotated, kNow), IsOkAndHolds(content_));
  const std::string newer = *SealToken(content_, rotated->sealing(), kNow);
  EXPECT_THAT(Open(newer), StatusIs(kPrecondition, HasSubstr("no key 'new'")));
}

TEST_F(TokenTest, NoMemoryIsTakenForMoreThanASessionSays) {
  const std::string incompressible = [] {
    std::mt19937 random(1);
    std::string bytes(kMaxTokenBytes + 1000, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    return bytes;
  }();
  EXPECT_THAT(SealToken(incompressible, keys_.sealing(), kNow),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("at most 16777216")));
  EXPECT_THAT(SealToken(std::string(kMaxSealedBytes + 1, '\0'), keys_.sealing(), kNow),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("a checkpoint holds")));
  EXPECT_THAT(Open(token_ + incompressible), StatusIs(kPrecondition, HasSubstr("longer than any")));
}

// Signed rightly, by a server that is wrong itself.
TEST_F(TokenTest, ARightSignatureIsNotTrustedBlindly) {
  const std::string unsigned_token = token_.substr(0, token_.size() - 32);
  EXPECT_EQ(Signed(unsigned_token, keys_.sealing()), token_);
  std::string token = unsigned_token;
  token[size_at_] = '\xff';  // it says that it holds 4 GB
  EXPECT_THAT(Open(Signed(token, keys_.sealing())), StatusIs(kPrecondition, HasSubstr("more than any session")));
  for (const int change : {-1, 1}) {
    token = unsigned_token;
    token[size_at_ + 3] = static_cast<char>(token[size_at_ + 3] + change);
    EXPECT_THAT(Open(Signed(token, keys_.sealing())), StatusIs(kPrecondition, HasSubstr("does not hold what it says")));
  }
  token = unsigned_token;
  token[body_at_ + 4] = static_cast<char>(token[body_at_ + 4] + 1);
  EXPECT_THAT(Open(Signed(token, keys_.sealing())), StatusIs(kPrecondition, HasSubstr("does not hold what it says")));
}

TEST_F(TokenTest, GarbageIsRefused) {
  std::mt19937 random(7);
  for (int round = 0; round < 20'000; ++round) {
    const std::string token = Mutate(token_, body_at_, random);
    if (token == token_) continue;
    EXPECT_THAT(Open(token), StatusIs(kPrecondition)) << absl::CHexEscape(token);
    const absl::Status again = Open(Signed(token.substr(0, token.size() - std::min<size_t>(32, token.size())),
                                           keys_.sealing()));  // signed anew, so that the rest is looked at
    EXPECT_THAT(again, AnyOf(IsOk(), StatusIs(kPrecondition))) << absl::CHexEscape(token);
  }
}

}  // namespace
}  // namespace holdfast
