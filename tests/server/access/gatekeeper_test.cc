// SPDX-License-Identifier: Apache-2.0
#include "server/access/gatekeeper.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "api/errors.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kPeer[] = "ipv4:192.0.2.7:40000";
constexpr char kAnne[] = "Bearer token-of-anne-0001";
constexpr char kBob[] = "bearer token-of-bob-00001";

class GatekeeperTest : public ::testing::Test {
 protected:
  void Write(const std::string& text) const { std::ofstream(path_) << text; }
  void Open() {
    auto gatekeeper = Gatekeeper::Create(path_, clock_, log_);
    ASSERT_THAT(gatekeeper, IsOk());
    gatekeeper_ = *std::move(gatekeeper);
  }
  void OpenForAnneAndBob() {
    Write("anne:token-of-anne-0001 max_sessions=2\nbob:token-of-bob-00001\n");
    Open();
  }
  int64_t Lines() const {
    const std::string text = lines_.str();
    return std::count(text.begin(), text.end(), '\n');
  }

  const TempDir dir_;
  const std::string path_ = dir_.File("tokens");
  SimulatedClock clock_;
  std::ostringstream lines_;
  const std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines_));
  std::unique_ptr<Gatekeeper> gatekeeper_;
};

TEST_F(GatekeeperTest, WithoutAFileEverybodyIsLetInNameless) {
  const auto gatekeeper = Gatekeeper::Create("", clock_, log_);
  ASSERT_THAT(gatekeeper, IsOk());
  for (int i = 0; i < 3; ++i) {
    const auto pass = (*gatekeeper)->Admit(i == 0 ? "" : "Bearer whatever", kPeer);
    ASSERT_THAT(pass, IsOk());
    EXPECT_EQ(pass->grant().name, "");
  }
}

TEST_F(GatekeeperTest, LetsInWhomTheFileNames) {
  OpenForAnneAndBob();
  const auto anne = gatekeeper_->Check(kAnne, kPeer), bob = gatekeeper_->Check(kBob, kPeer);
  ASSERT_THAT(anne, IsOk());
  ASSERT_THAT(bob, IsOk());
  EXPECT_EQ(anne->name, "anne");
  EXPECT_EQ(bob->name, "bob");
}

TEST_F(GatekeeperTest, RefusesNoTokenAnotherSchemeAndAnUnknownOne) {
  OpenForAnneAndBob();
  for (const char* none : {"", "Basic token-of-anne-0001", "token-of-anne-0001", "Bearer "}) {
    EXPECT_THAT(gatekeeper_->Check(none, kPeer),
                StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("authorization: Bearer")))
        << none;
  }
  const std::string endless = "Bearer " + std::string(1 << 20, 'x');
  for (const std::string& unknown : {std::string("Bearer token-of-carol-001"), endless}) {
    EXPECT_THAT(gatekeeper_->Admit(unknown, kPeer).status(),
                StatusIs(absl::StatusCode::kUnauthenticated, Not(HasSubstr("carol"))));
  }
}

TEST_F(GatekeeperTest, CountsWhatANameHasOpen) {
  OpenForAnneAndBob();
  std::optional<Gatekeeper::Pass> first = *gatekeeper_->Admit(kAnne, kPeer);
  const Gatekeeper::Pass second = *gatekeeper_->Admit(kAnne, kPeer);
  const auto third = gatekeeper_->Admit(kAnne, kPeer);
  EXPECT_THAT(third.status(), StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("anne")));
  ASSERT_TRUE(OverloadDetails(third.status()));
  EXPECT_GT(OverloadDetails(third.status())->retry_after, absl::ZeroDuration());
  EXPECT_THAT(gatekeeper_->Admit(kBob, kPeer), IsOk()) << "another's are not hers";
  first->GiveBack();
  EXPECT_EQ(first->grant().name, "anne");
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer), IsOk());
  first.reset();
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer), IsOk()) << "given back once";
  const Gatekeeper::Pass third_now = *gatekeeper_->Admit(kAnne, kPeer);
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer).status(), StatusIs(absl::StatusCode::kResourceExhausted));
}

TEST_F(GatekeeperTest, WhoLeavesMakesRoomForAsManyAndNoMore) {
  OpenForAnneAndBob();
  std::vector<Gatekeeper::Pass> leaving;
  for (int i = 0; i < 2; ++i) {
    leaving.push_back(*gatekeeper_->Admit(kAnne, kPeer));
    leaving.back().Leave();
    leaving.back().Leave();
  }
  std::vector<Gatekeeper::Pass> open;
  for (int i = 0; i < 2; ++i) open.push_back(*gatekeeper_->Admit(kAnne, kPeer));
  open.front().Leave();
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer).status(), StatusIs(absl::StatusCode::kResourceExhausted))
      << "three never leave";
  leaving.front().GiveBack();
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer), IsOk());
  leaving.clear();
  open.clear();
  for (int i = 0; i < 2; ++i) open.push_back(*gatekeeper_->Admit(kAnne, kPeer));
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer).status(), StatusIs(absl::StatusCode::kResourceExhausted))
      << "all were given back, once";
}

TEST_F(GatekeeperTest, AChangedFileCountsForWhoComesNext) {
  OpenForAnneAndBob();
  const Gatekeeper::Pass anne = *gatekeeper_->Admit(kAnne, kPeer);
  Write("bob:token-of-bob-00001\n");
  clock_.Advance(kFileCheckPeriod);
  EXPECT_THAT(gatekeeper_->Admit(kAnne, kPeer).status(), StatusIs(absl::StatusCode::kUnauthenticated));
  EXPECT_THAT(gatekeeper_->Admit(kBob, kPeer), IsOk());
  EXPECT_EQ(anne.grant().name, "anne") << "who is in stays in";
}

TEST_F(GatekeeperTest, AStrangerDoesNotFillTheLog) {
  OpenForAnneAndBob();
  for (int i = 0; i < 1000; ++i) ASSERT_FALSE(gatekeeper_->Check("Bearer token-of-nobody-01", kPeer).ok());
  EXPECT_EQ(Lines(), 1);
  EXPECT_THAT(lines_.str(), AllOf(HasSubstr(kPeer), Not(HasSubstr("token-of-nobody"))));
  clock_.Advance(absl::Minutes(1));
  ASSERT_FALSE(gatekeeper_->Check("", kPeer).ok());
  EXPECT_EQ(Lines(), 2);
  EXPECT_THAT(lines_.str(), HasSubstr("999 more"));
}

TEST_F(GatekeeperTest, AServerDoesNotStartWithAWrongFile) {
  EXPECT_THAT(Gatekeeper::Create(path_, clock_, log_), StatusIs(absl::StatusCode::kNotFound, HasSubstr(path_)));
  Write("anne:short\n");
  EXPECT_THAT(Gatekeeper::Create(path_, clock_, log_),
              StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr(path_), HasSubstr("line 1"))));
}

}  // namespace
}  // namespace holdfast
