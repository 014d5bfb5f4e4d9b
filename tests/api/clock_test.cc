// SPDX-License-Identifier: Apache-2.0
#include "api/clock.h"

#include <gtest/gtest.h>

#include <thread>

#include "api/steady_event.h"
#include "proto/grpc_deadline.h"
#include "tests/support/simulated_clock.h"

namespace holdfast {
namespace {

TEST(ClockTest, TheTwoTimesMoveTogetherUntilTheWallClockIsSet) {
  SimulatedClock clock;
  const absl::Time wall = clock.WallNow();
  const SteadyTime steady = clock.SteadyNow();
  clock.Advance(absl::Seconds(3));
  EXPECT_EQ(clock.WallNow() - wall, absl::Seconds(3));
  EXPECT_EQ(clock.Since(steady), absl::Seconds(3));
  clock.SetWallBy(-absl::Hours(2));
  EXPECT_EQ(clock.WallNow() - wall, absl::Seconds(3) - absl::Hours(2));
  EXPECT_EQ(clock.Since(steady), absl::Seconds(3));
}

TEST(ClockTest, TheSystemsSteadyTimeNeverGoesBack) {
  const SystemClock clock;
  SteadyTime last = clock.SteadyNow();
  for (int i = 0; i < 1000; ++i) {
    const SteadyTime now = clock.SteadyNow();
    ASSERT_GE(now, last);
    last = now;
  }
}

TEST(SteadyEventTest, AWaitEndsWhenTheEventHappensAndTakesIt) {
  SteadyEvent event;
  std::thread other([&event] { event.Notify(); });
  EXPECT_TRUE(event.WaitFor(absl::InfiniteDuration()));
  other.join();
  EXPECT_FALSE(event.WaitFor(absl::ZeroDuration()));
  event.Notify();
  event.Notify();
  EXPECT_TRUE(event.WaitFor(absl::ZeroDuration()));
  EXPECT_FALSE(event.WaitFor(-absl::Seconds(1)));
}

TEST(SteadyEventTest, AWaitEndsWhenItsTimeIsOver) {
  const SystemClock clock;
  const SteadyTime begin = clock.SteadyNow();
  SteadyEvent event;
  EXPECT_FALSE(event.WaitFor(absl::Milliseconds(20)));
  EXPECT_GE(clock.Since(begin), absl::Milliseconds(20));
}

TEST(SteadyDeadlineTest, LiesOnTheSteadyClock) {
  const gpr_timespec before = gpr_now(GPR_CLOCK_MONOTONIC);
  const gpr_timespec deadline = SteadyDeadline(absl::Seconds(5));
  EXPECT_EQ(deadline.clock_type, GPR_CLOCK_MONOTONIC);
  EXPECT_GE(gpr_time_to_millis(gpr_time_sub(deadline, before)), 5000);
  const gpr_timespec past = SteadyDeadline(-absl::Seconds(5));
  EXPECT_LE(gpr_time_cmp(past, gpr_now(GPR_CLOCK_MONOTONIC)), 0);
  EXPECT_GT(gpr_time_cmp(SteadyDeadline(absl::InfiniteDuration()), deadline), 0);
}

}  // namespace
}  // namespace holdfast
