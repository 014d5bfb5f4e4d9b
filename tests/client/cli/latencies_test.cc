// SPDX-License-Identifier: Apache-2.0
#include "client/cli/latencies.h"

#include <gtest/gtest.h>

namespace holdfast {
namespace {

TEST(LatenciesTest, NothingTakesNoTime) { EXPECT_EQ(Latencies().Percentile(95), absl::ZeroDuration()); }

TEST(LatenciesTest, OfAHundredEachIsAPercentile) {
  Latencies latencies;
  for (int i = 100; i >= 1; --i) latencies.Add(absl::Milliseconds(i));
  EXPECT_EQ(latencies.Percentile(0), absl::Milliseconds(1));
  EXPECT_EQ(latencies.Percentile(1), absl::Milliseconds(1));
  EXPECT_EQ(latencies.Percentile(50), absl::Milliseconds(50));
  EXPECT_EQ(latencies.Percentile(95), absl::Milliseconds(95));
  EXPECT_EQ(latencies.Percentile(100), absl::Milliseconds(100));
}

TEST(LatenciesTest, FewOnesRoundUp) {
  Latencies latencies, more;
  latencies.Add(absl::Milliseconds(30));
  more.Add(absl::Milliseconds(10));
  more.Add(absl::Milliseconds(20));
  latencies.Add(more);
  EXPECT_EQ(latencies.count(), 3u);
  EXPECT_EQ(latencies.Percentile(50), absl::Milliseconds(20));
  EXPECT_EQ(latencies.Percentile(99), absl::Milliseconds(30));
}

}  // namespace
}  // namespace holdfast
