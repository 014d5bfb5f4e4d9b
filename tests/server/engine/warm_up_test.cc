// SPDX-License-Identifier: Apache-2.0
#include "server/engine/warm_up.h"

#include <gtest/gtest.h>

#include <new>
#include <stdexcept>

#include "tests/support/fake_tracker_model.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

const RgbImage kPicture{{32, 32}, std::vector<uint8_t>(32 * 32 * 3)};

TEST(WarmUpTest, TellsWhatTheNetworkCostsWhenItIsWarmAndNothingGetsInBetween) {
  SimulatedClock clock;
  FakeTrackerModel model;
  int runs = 0;
  model.before_encode = [&] {
    // Kernels are compiled the first time, and a neighbour is there the second time.
    clock.Advance(++runs == 1 ? absl::Seconds(60) : runs == 2 ? absl::Milliseconds(400) : absl::Microseconds(102400));
  };
  model.before_refine = [&](absl::Span<const WindowGroup> groups) {
    const auto rows = static_cast<double>(groups.front().rows.size());
    clock.Advance(4 * (absl::Milliseconds(3) + rows * absl::Milliseconds(2)));
  };
  const absl::StatusOr<WorkCosts> costs = WarmUp(model, kPicture, 4, clock);
  ASSERT_THAT(costs, IsOk());
  EXPECT_NEAR(costs->pixel, 1e-4, 1e-9);
  EXPECT_NEAR(costs->row, 2e-3, 1e-9);
  EXPECT_NEAR(costs->batch, 3e-3, 1e-9);
}

TEST(WarmUpTest, ManyRowsThatTakeLessThanOneStillGiveCostsThatMakeSense) {
  SimulatedClock clock;
  FakeTrackerModel model;
  model.before_refine = [&](absl::Span<const WindowGroup> groups) {
    clock.Advance(groups.front().rows.size() == 1 ? absl::Seconds(1) : absl::Milliseconds(640));
  };
  const absl::StatusOr<WorkCosts> costs = WarmUp(model, kPicture, 1, clock);
  ASSERT_THAT(costs, IsOk());
  EXPECT_NEAR(costs->row, 10e-3, 1e-9);
  EXPECT_EQ(costs->batch, 0);
}

TEST(WarmUpTest, ASlowNetworkIsNotRunOftenerThanItTakesToKnow) {
  SimulatedClock clock;
  FakeTrackerModel model;
  model.before_encode = [&] { clock.Advance(absl::Seconds(3)); };
  ASSERT_THAT(WarmUp(model, kPicture, 1, clock), IsOk());
  EXPECT_EQ(model.counts()->frames, 2);
}

TEST(WarmUpTest, ANetworkThatDoesNotRunIsAnError) {
  SimulatedClock clock;
  FakeTrackerModel model;
  model.before_encode = [] { throw std::bad_alloc(); };
  EXPECT_THAT(WarmUp(model, kPicture, 1, clock), StatusIs(absl::StatusCode::kResourceExhausted));
  model.before_encode = [] { throw std::runtime_error("no kernel"); };
  EXPECT_THAT(WarmUp(model, kPicture, 1, clock), StatusIs(absl::StatusCode::kInternal));
}

}  // namespace
}  // namespace holdfast
