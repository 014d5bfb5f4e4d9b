// SPDX-License-Identifier: Apache-2.0
#include "client/reconnect_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "api/errors.h"

namespace holdfast {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class ReconnectPlanTest : public ::testing::Test {
 protected:
  ReconnectPlan Plan(size_t servers, absl::Duration timeout = absl::Minutes(2)) {
    return ReconnectPlan({servers, timeout, Backoff::Options()}, [] { return 0.5; });
  }
  // Goes through the next attempt, to its server's index; -1: there is none.
  int Try(ReconnectPlan& plan) {
    const auto attempt = plan.Next(now_);
    if (!attempt) return -1;
    now_ = attempt->at;
    return static_cast<int>(attempt->server);
  }

  const absl::Status absent_ = absl::UnavailableError("no such server");
  const absl::Status refused_ = absl::FailedPreconditionError("other keys");
  SteadyTime now_{seconds(1000)};
};

TEST_F(ReconnectPlanTest, GoesInRotationFromTheNextServerWithABackoff) {
  ReconnectPlan plan = Plan(3);
  plan.Lost(1, now_, true);
  const SteadyTime lost = now_;
  EXPECT_EQ(Try(plan), 2);
  EXPECT_EQ(now_ - lost, milliseconds(100));
  EXPECT_TRUE(plan.Failed(absent_, now_));
  EXPECT_EQ(Try(plan), 0);
  EXPECT_EQ(now_ - lost, milliseconds(260));
  EXPECT_TRUE(plan.Failed(absl::DeadlineExceededError("no answer"), now_));
  EXPECT_EQ(Try(plan), 1);
  EXPECT_EQ(Try(plan), 2);
}

TEST_F(ReconnectPlanTest, AsksTheServerThatWasLostFirstWhereOnlyThatOneCanGoOn) {
  ReconnectPlan plan = Plan(3);
  plan.Lost(1, now_, true);
  plan.StayFirst();
  EXPECT_EQ(Try(plan), 1);
  EXPECT_EQ(Try(plan), 2);
}

TEST_F(ReconnectPlanTest, GivesUpWhenTheNextAttemptWouldBeTooLate) {
  ReconnectPlan plan = Plan(1, absl::Seconds(1));
  plan.Lost(0, now_, true);
  const SteadyTime lost = now_;
  EXPECT_EQ(plan.TimeLeft(now_), absl::Seconds(1));
  int attempts = 0;
  while (Try(plan) == 0) ++attempts;
  EXPECT_EQ(attempts, 4);  // after 100, 260, 516, 926 ms
  EXPECT_LE(now_ - lost, seconds(1));
  EXPECT_EQ(Try(plan), -1);
}

TEST_F(ReconnectPlanTest, WithoutTimeThereIsNoAttempt) {
  ReconnectPlan plan = Plan(2, absl::ZeroDuration());
  plan.Lost(0, now_, true);
  EXPECT_EQ(Try(plan), -1);
}

TEST_F(ReconnectPlanTest, EndlessTimeIsNoOverflow) {
  ReconnectPlan plan = Plan(1, absl::InfiniteDuration());
  plan.Lost(0, now_, true);
  EXPECT_EQ(Try(plan), 0);
  EXPECT_GT(plan.TimeLeft(now_), absl::Hours(1000));
}

TEST_F(ReconnectPlanTest, ALossWithoutRecoveryCountsAsTheOneBefore) {
  ReconnectPlan plan = Plan(1, absl::Seconds(1));
  plan.Lost(0, now_, true);
  int losses = 0;
  for (; Try(plan) == 0; ++losses) plan.Lost(0, now_, false);
  EXPECT_EQ(losses, 4);
  plan.Lost(0, now_, true);
  EXPECT_EQ(Try(plan), 0);
}

TEST_F(ReconnectPlanTest, AServerThatSaysWhenIsNotAskedBefore) {
  ReconnectPlan plan = Plan(2);
  plan.Lost(0, now_, true);
  EXPECT_EQ(Try(plan), 1);
  const SteadyTime told = now_;
  EXPECT_TRUE(plan.Failed(OverloadError("sessions", "16 of 16", absl::Seconds(3)), now_));
  for (now_ = told; now_ < told + seconds(2);) EXPECT_EQ(Try(plan), 0);
  EXPECT_TRUE(plan.Failed(OverloadError("sessions", "16 of 16", absl::Seconds(30)), now_));
  EXPECT_EQ(Try(plan), 1);
  EXPECT_GE(now_ - told, seconds(3));
}

TEST_F(ReconnectPlanTest, AnOverloadThatWillNotPassEndsIt) {
  ReconnectPlan plan = Plan(2);
  plan.Lost(0, now_, true);
  Try(plan);
  EXPECT_FALSE(plan.Failed(OverloadError("points", "at most 8", absl::ZeroDuration()), now_));
  EXPECT_FALSE(plan.Failed(absl::InvalidArgumentError("config"), now_));
}

TEST_F(ReconnectPlanTest, AServerThatRefusesTheSessionIsNotAskedAgain) {
  ReconnectPlan plan = Plan(3);
  plan.Lost(2, now_, true);
  EXPECT_EQ(Try(plan), 0);
  EXPECT_TRUE(plan.Failed(refused_, now_));
  EXPECT_EQ(Try(plan), 1);
  EXPECT_TRUE(plan.Failed(refused_, now_));
  EXPECT_EQ(Try(plan), 2);
  EXPECT_TRUE(plan.Failed(absent_, now_));
  EXPECT_EQ(Try(plan), 2);
  EXPECT_FALSE(plan.Failed(refused_, now_));
}

}  // namespace
}  // namespace holdfast
