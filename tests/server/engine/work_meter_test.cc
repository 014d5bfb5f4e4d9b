// SPDX-License-Identifier: Apache-2.0
#include "server/engine/work_meter.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"

namespace holdfast {
namespace {

// A row takes a millisecond an iteration, so that a point-frame takes half a one: 4 iterations every 8 frames.
constexpr WorkCosts kCosts{/*pixel=*/1e-6, /*batch=*/2e-3, /*row=*/1e-3};

SessionAccepted SessionOf(ImageSize size, int hop, int iterations) {
  SessionAccepted session;
  session.processing_size = size;
  session.hop_frames = hop;
  session.iterations = iterations;
  return session;
}

class WorkMeterTest : public ::testing::Test {
 protected:
  WorkMeter Meter(double max_load = 1) { return WorkMeter({kCosts, 8, 4, max_load}, clock_, metrics_); }
  SimulatedClock clock_;
  RecordingMetrics metrics_;
};

TEST_F(WorkMeterTest, APointOnAFrameIsTheUnitAndAFrameCountsForWhatItTakes) {
  const WorkMeter meter = Meter();
  const WorkMeter::FrameWork standard = meter.Of(SessionOf({100, 100}, 8, 4));
  EXPECT_DOUBLE_EQ(standard.point, 1);
  EXPECT_DOUBLE_EQ(standard.frame, 22);  // 10 ms to encode and 1 ms of each batch, in halves of a millisecond
  const WorkMeter::FrameWork dense = meter.Of(SessionOf({200, 100}, 4, 6));
  EXPECT_DOUBLE_EQ(dense.point, 3);
  EXPECT_DOUBLE_EQ(dense.frame, 46);
}

TEST_F(WorkMeterTest, TheBudgetIsTheShareOfASecondThatMayBePromised) {
  EXPECT_DOUBLE_EQ(Meter(1).Budget(), 2000);
  EXPECT_DOUBLE_EQ(Meter(0.75).Budget(), 1500);
  EXPECT_DOUBLE_EQ(metrics_.totals().work_budget, 1500);
}

TEST_F(WorkMeterTest, NothingIsBoundedWhereCostsAreUnknownOrTheLoadMayBeAny) {
  EXPECT_TRUE(std::isinf(Meter(0).Budget()));
  WorkMeter unknown({{}, 8, 4, 1}, clock_, metrics_);
  EXPECT_TRUE(std::isinf(unknown.Budget()));
  unknown.Encoded(100, absl::Seconds(1));
  EXPECT_TRUE(std::isinf(unknown.Budget()));
  EXPECT_EQ(unknown.Of(SessionOf({100, 100}, 8, 4)).frame, 0);
}

TEST_F(WorkMeterTest, BatchesThatTakeLongerMakeTheBudgetSmallerUntilTheyAreForgotten) {
  WorkMeter meter = Meter();
  for (int i = 0; i < 200; ++i) {
    meter.Encoded(100'000, absl::Milliseconds(300));  // 100 ms at warm-up
    meter.Refined(48, 4, absl::Milliseconds(600));    // 200 ms
    clock_.Advance(absl::Milliseconds(900));
  }
  EXPECT_NEAR(meter.Budget(), 2000 / 3.0, 100);
  EXPECT_NEAR(metrics_.totals().work_budget, meter.Budget(), 50) << "as of the last batch";
  EXPECT_DOUBLE_EQ(meter.QuietBudget(), 2000);
  clock_.Advance(absl::Minutes(2));
  EXPECT_NEAR(meter.Budget(), 2000, 10);
}

TEST_F(WorkMeterTest, OneSlowBatchSaysLittleAndFastOnesRaiseTheBudget) {
  WorkMeter meter = Meter();
  meter.Encoded(10'000, absl::Milliseconds(100));  // ten times what it took at warm-up
  EXPECT_GT(meter.Budget(), 1500);
  for (int i = 0; i < 200; ++i) meter.Encoded(100'000, absl::Milliseconds(50));
  EXPECT_GT(meter.Budget(), 3500);
}

}  // namespace
}  // namespace holdfast
