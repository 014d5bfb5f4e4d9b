// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/token_sealer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/null_sink.h>

#include <fstream>
#include <iostream>
#include <random>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/checkpoint/state_convert.h"
#include "server/checkpoint/token.h"
#include "tests/server/checkpoint/random_state.h"
#include "tests/support/mutate.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;

const char kOne[] = "one:abababababababababababababababababababababababababababababababab\n";
const char kTwo[] = "two:cdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcd\n";

class TokenSealerTest : public ::testing::Test {
 protected:
  std::unique_ptr<TokenSealer> WithKeys(const std::string& keys) {
    std::ofstream(dir_.File(absl::StrCat("keys", ++files_))) << keys;
    return Create({dir_.File(absl::StrCat("keys", files_)), absl::Hours(24)});
  }
  std::unique_ptr<TokenSealer> Create(const TokenSealer::Options& options) {
    auto sealer = TokenSealer::Create(options, clock_, log_);
    EXPECT_THAT(sealer, IsOk());
    return *std::move(sealer);
  }

  const TempDir dir_;
  int files_ = 0;
  SimulatedClock clock_;
  const std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>());
};

TEST_F(TokenSealerTest, StatesSurviveBitByBit) {
  const auto sealer = Create({});
  RandomState random(11);
  for (int round = 0; round < 20; ++round) {
    const SessionState state = random.Session({/*tracks=*/round, /*channels=*/64, /*patches=*/round % 2 == 0});
    const auto token = sealer->Seal(state);
    ASSERT_THAT(token, IsOk());
    const auto back = sealer->Unseal(*token);
    ASSERT_THAT(back, IsOk());
    EXPECT_EQ(StateBits::Of(*back), StateBits::Of(state));
  }
}

TEST_F(TokenSealerTest, ServersWithTheSameKeysTakeEachOthersTokens) {
  const SessionState state = RandomState(12).Session({});
  const auto one = WithKeys(kOne);
  const auto rotating = WithKeys(absl::StrCat(kTwo, kOne));
  const auto two = WithKeys(kTwo);
  EXPECT_TRUE(one->outlives_process());
  EXPECT_THAT(rotating->Unseal(*one->Seal(state)), IsOk());  // the old one's
  EXPECT_THAT(two->Unseal(*rotating->Seal(state)), IsOk());  // sealed with the new one
  EXPECT_THAT(two->Unseal(*one->Seal(state)), StatusIs(kPrecondition, HasSubstr("other keys")));
}

TEST_F(TokenSealerTest, ARandomKeyIsOfThisProcessAlone) {
  const SessionState state = RandomState(13).Session({});
  const auto sealer = Create({});
  const auto other = Create({});
  EXPECT_FALSE(sealer->outlives_process());
  const auto token = sealer->Seal(state);
  ASSERT_THAT(token, IsOk());
  EXPECT_THAT(sealer->Unseal(*token), IsOk());
  EXPECT_THAT(other->Unseal(*token), StatusIs(kPrecondition, HasSubstr("other keys")));
}

TEST_F(TokenSealerTest, TokensGrowTooOldByTheWallClock) {
  const auto sealer = Create({"", absl::Hours(2)});
  const auto forever = Create({"", absl::InfiniteDuration()});
  const auto token = sealer->Seal(RandomState(14).Session({}));
  const auto lasting = forever->Seal(RandomState(14).Session({}));
  clock_.Advance(absl::Hours(2));
  EXPECT_THAT(sealer->Unseal(*token), IsOk());
  clock_.SetWallBy(absl::Seconds(1));
  EXPECT_THAT(sealer->Unseal(*token), StatusIs(kPrecondition, HasSubstr("too old")));
  clock_.SetWallBy(absl::Hours(-3));  // a server whose clock is slow
  EXPECT_THAT(sealer->Unseal(*token), IsOk());
  clock_.SetWallBy(absl::Hours(100'000));
  EXPECT_THAT(forever->Unseal(*lasting), IsOk());
}

TEST_F(TokenSealerTest, AServerWithoutItsKeysDoesNotStart) {
  EXPECT_THAT(TokenSealer::Create({dir_.File("none")}, clock_, log_).status(), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(TokenSealerTest, WhatOutgrowsATokenIsToldSo) {
  const auto sealer = Create({});
  SessionState state = RandomState(15).Session({1, 1, false});
  state.tracks[0].state.seed.feature.resize(kMaxSealedBytes / 4);
  EXPECT_THAT(sealer->Seal(state), StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("a checkpoint holds")));
  EXPECT_THAT(sealer->Seal(RandomState(15).Session({1000, 5000, false})),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("at most 16777216")));
}

TEST_F(TokenSealerTest, ASealedStateThatMakesNoSenseIsRefused) {
  const auto sealer = WithKeys(kOne);
  const KeyRing keys = *KeyRing::Parse(kOne);
  const auto unseal = [&](const std::string& content) {
    return sealer->Unseal(*SealToken(content, keys.sealing(), clock_.WallNow())).status();
  };
  checkpoint::v1::SessionState message = ToProto(RandomState(16).Session({}));
  EXPECT_THAT(unseal(message.SerializeAsString()), IsOk());
  message.mutable_tracks(1)->clear_position_x();
  EXPECT_THAT(unseal(message.SerializeAsString()),
              StatusIs(kPrecondition, HasSubstr("track 1: there are no estimates")));
  EXPECT_THAT(unseal("\xff\xff\xff"), StatusIs(kPrecondition, HasSubstr("no session's state")));
  EXPECT_THAT(unseal(""), StatusIs(kPrecondition, HasSubstr("malformed")));
}

TEST_F(TokenSealerTest, MutatedStatesAreTakenOrRefusedButNeverHarm) {
  const auto sealer = WithKeys(kOne);
  const KeyRing keys = *KeyRing::Parse(kOne);
  std::mt19937 random(17);
  const std::string good = ToProto(RandomState(17).Session({3, 4, true})).SerializeAsString();
  for (int round = 0; round < 5000; ++round) {
    const std::string content = Mutate(good, good.size(), random);
    const auto state = sealer->Unseal(*SealToken(content, keys.sealing(), clock_.WallNow()));
    EXPECT_THAT(state, AnyOf(IsOk(), StatusIs(kPrecondition)));
  }
}

TEST_F(TokenSealerTest, APointTakesAboutAKilobyteAndAPatchHalfOfOneMore) {
  const auto sealer = Create({});
  for (const int channels : {64, 128}) {
    for (const bool patches : {false, true}) {
      const auto token = sealer->Seal(RandomState(18).Session({256, channels, patches}));
      ASSERT_THAT(token, IsOk());
      const int64_t bytes = static_cast<int64_t>(token->size()) / 256;
      std::cout << channels << " channels, " << (patches ? "with" : "without") << " patches: " << bytes
                << " bytes a point\n";
      EXPECT_LT(bytes, patches ? 1700 : 1200);
    }
  }
}

}  // namespace
}  // namespace holdfast
