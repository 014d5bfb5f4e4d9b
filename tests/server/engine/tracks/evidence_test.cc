// SPDX-License-Identifier: Apache-2.0
#include "server/engine/evidence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "absl/base/casts.h"

namespace holdfast {
namespace {

TEST(EvidenceTest, CoarseValuesAreNearAndEndInZeroes) {
  for (const float value : {0.9f, -0.7f, 1e-6f, 3.14159f, -17.3f, 255.9f, 1e30f, 0.0f}) {
    const float coarse = Coarse(value);
    EXPECT_NEAR(coarse, value, std::abs(value) / 256);
    EXPECT_EQ(absl::bit_cast<uint32_t>(coarse) & 0xFFFF, 0u) << value;
    EXPECT_EQ(Coarse(coarse), coarse);
  }
}

TEST(EvidenceTest, WhatIsNoNumberStaysSo) {
  EXPECT_TRUE(std::isnan(Coarse(std::numeric_limits<float>::quiet_NaN())));
  EXPECT_EQ(Coarse(std::numeric_limits<float>::infinity()), std::numeric_limits<float>::infinity());
}

}  // namespace
}  // namespace holdfast
