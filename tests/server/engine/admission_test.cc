// SPDX-License-Identifier: Apache-2.0
#include "server/engine/admission.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "api/errors.h"
#include "server/engine/latency_log.h"
#include "tests/support/recorders.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;

TEST(AdmissionTest, RefusesMoreSessionsThanThereAreAndAdmitsAgainWhenOneEnds) {
  RecordingMetrics metrics;
  Admission admission({2, 1000}, metrics);
  auto first = admission.Admit(1);
  auto second = admission.Admit(1);
  const auto third = admission.Admit(1);
  ASSERT_THAT(third, StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(OverloadDetails(third.status())->subject, "sessions");
  EXPECT_GT(OverloadDetails(third.status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(metrics.totals().rejected_sessions, 1);
  first->reset();
  EXPECT_THAT(admission.Admit(1), IsOk());
}

TEST(AdmissionTest, RefusesASessionWhoseFeaturesDoNotFit) {
  RecordingMetrics metrics;
  Admission admission({10, 1000}, metrics);
  auto first = admission.Admit(600);
  EXPECT_GT(OverloadDetails(admission.Admit(500).status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(OverloadDetails(admission.Admit(1001).status())->retry_after, absl::ZeroDuration()) << "it will never fit";
  EXPECT_THAT(admission.Admit(400), IsOk());
  EXPECT_EQ(metrics.totals().rejected_memory, 2);
}

TEST(LatencyLogTest, TellsTheFirstAndTheFinalEstimateOfAFrameOnce) {
  RecordingMetrics metrics;
  LatencyLog log(metrics);
  const SteadyTime start;
  for (int i = 0; i < 4; ++i) log.Arrived(start + std::chrono::seconds(i));
  log.Estimated(0, 2, start + std::chrono::seconds(10));
  log.Estimated(1, 3, start + std::chrono::seconds(10));
  log.Final(1, start + std::chrono::seconds(20));
  log.Final(1, start + std::chrono::seconds(30));
  const auto totals = metrics.totals();
  EXPECT_THAT(totals.first, ElementsAre(absl::Seconds(10), absl::Seconds(9), absl::Seconds(8)));
  EXPECT_THAT(totals.final, ElementsAre(absl::Seconds(20)));
}

TEST(LatencyLogTest, FramesWithoutPointsCountForNothing) {
  RecordingMetrics metrics;
  LatencyLog log(metrics);
  for (int i = 0; i < 4; ++i) log.Arrived(SteadyTime());
  log.Final(2, SteadyTime());
  log.Estimated(3, 4, SteadyTime());
  EXPECT_EQ(metrics.totals().final.size(), 0u);
  EXPECT_EQ(metrics.totals().first.size(), 1u);
}

}  // namespace
}  // namespace holdfast
