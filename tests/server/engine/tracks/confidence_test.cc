// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/confidence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace holdfast {
namespace {

TEST(ConfidenceTest, OfALogitIsTheLogisticFunction) {
  EXPECT_FLOAT_EQ(ConfidenceFromLogit(0), 0.5f);
  EXPECT_FLOAT_EQ(ConfidenceFromLogit(std::log(3.0f)), 0.75f);
  EXPECT_FLOAT_EQ(ConfidenceFromLogit(-1000), 0.0f);
  EXPECT_FLOAT_EQ(ConfidenceFromLogit(1000), 1.0f);
}

TEST(ConfidenceTest, OfAMatchGrowsWithLikenessAndFallsWithTheLastStep) {
  EXPECT_FLOAT_EQ(ConfidenceFromMatch(0.95f, 0), 1.0f);
  EXPECT_FLOAT_EQ(ConfidenceFromMatch(0.5f, 0), 0.5f);
  EXPECT_FLOAT_EQ(ConfidenceFromMatch(-1.0f, 0), 0.0f);
  EXPECT_FLOAT_EQ(ConfidenceFromMatch(1.0f, 1.0f), 0.5f);
  EXPECT_LT(ConfidenceFromMatch(1.0f, 8.0f), 0.02f);
}

TEST(ConfidenceTest, OfNothingKnownIsZero) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(ConfidenceFromLogit(nan), 0.0f);
  EXPECT_EQ(ConfidenceFromMatch(nan, 0), 0.0f);
  EXPECT_EQ(ConfidenceFromMatch(1, nan), 0.0f);
}

}  // namespace
}  // namespace holdfast
