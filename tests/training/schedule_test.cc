// SPDX-License-Identifier: Apache-2.0
#include "training/schedule.h"

#include <gtest/gtest.h>

namespace holdfast {
namespace {

TEST(ScheduleTest, RisesInAStraightLineAndFallsInOne) {
  const ScheduleOptions options = {1.0, 0.1, 25, 250000};
  EXPECT_DOUBLE_EQ(LearningRate(options, 0), 0.04);
  EXPECT_NEAR(LearningRate(options, 0.05), 0.52, 1e-12);
  EXPECT_DOUBLE_EQ(LearningRate(options, 0.1), 1.0);
  EXPECT_NEAR(LearningRate(options, 0.55), 0.5, 1e-5);
  EXPECT_NEAR(LearningRate(options, 1), 1.0 / 250000, 1e-12);
}

TEST(ScheduleTest, StaysAtItsEndsOutside) {
  const ScheduleOptions options;
  EXPECT_DOUBLE_EQ(LearningRate(options, -1), LearningRate(options, 0));
  EXPECT_DOUBLE_EQ(LearningRate(options, 2), LearningRate(options, 1));
}

}  // namespace
}  // namespace holdfast
