// SPDX-License-Identifier: Apache-2.0
#include "client/backoff.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace holdfast {
namespace {

constexpr double kMiddle = 0.5;  // of the jitter: none

TEST(BackoffTest, WaitsGrowByTheFactorUpToTheLongest) {
  Backoff backoff(Backoff::Options(), [] { return kMiddle; });
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(100));
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(160));
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(256));
  for (int i = 0; i < 20; ++i) backoff.Next();
  EXPECT_EQ(backoff.Next(), absl::Seconds(5));
  backoff.Reset();
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(100));
}

TEST(BackoffTest, JitterIsAFifthAtMostAndDoesNotAddUp) {
  double random = 0;
  Backoff backoff(Backoff::Options(), [&random] { return random; });
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(80));
  random = 1;
  EXPECT_EQ(backoff.Next(), absl::Milliseconds(192));
  for (int i = 0; i < 20; ++i) EXPECT_LE(backoff.Next(), absl::Seconds(6));
}

}  // namespace
}  // namespace holdfast
