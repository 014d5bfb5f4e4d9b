// SPDX-License-Identifier: Apache-2.0
#include "server/engine/admission.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "api/errors.h"
#include "server/engine/latency_log.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// With costs: a point-frame takes a millisecond, and a frame of 32x32 as much as ten points.
class AdmissionTest : public ::testing::Test {
 protected:
  static constexpr WorkCosts kCosts{/*pixel=*/1e-2 / 1024, /*batch=*/0, /*row=*/1e-3};

  Admission::Demand Memory(int64_t bytes) const {
    Admission::Demand demand;
    demand.bytes = bytes;
    return demand;
  }
  Admission::Demand Work(double frames_per_second, int64_t points, bool insists) const {
    SessionAccepted session;
    session.processing_size = {32, 32};
    session.hop_frames = session.iterations = 1;
    return {0, frames_per_second, insists, meter_.Of(session), points};
  }
  // By hop from 'least' on: the same of less work and more memory.
  std::vector<Admission::Demand> Hops(int least, int most, Admission::Demand demand) const {
    std::vector<Admission::Demand> demands;
    for (int hop = least; hop <= most; ++hop) {
      demands.push_back(demand);
      demands.back().bytes = 100 * hop;
      demands.back().work.point = demand.work.point / hop;
    }
    return demands;
  }
  static std::string Refusal(const absl::Status& status) {
    const auto overload = OverloadDetails(status);
    return overload ? overload->subject : "";
  }

  SimulatedClock clock_;
  RecordingMetrics metrics_;
  WorkMeter meter_{{kCosts, 1, 1, 1}, clock_, metrics_};  // 1000 point-frames a second
  Admission admission_{{3, 1000}, meter_, metrics_};
};

TEST_F(AdmissionTest, RefusesMoreSessionsThanThereAreAndAdmitsAgainWhenOneEnds) {
  auto first = admission_.Admit({Memory(1)});
  auto second = admission_.Admit({Memory(1)});
  auto third = admission_.Admit({Memory(1)});
  const auto fourth = admission_.Admit({Memory(1)});
  ASSERT_THAT(fourth, StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(Refusal(fourth.status()), "sessions");
  EXPECT_GT(OverloadDetails(fourth.status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kSessions], 1);
  EXPECT_EQ(admission_.CheckPlaces(), fourth.status());
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kSessions], 2);
  EXPECT_EQ(admission_.load().sessions, 3);
  first->reset();
  EXPECT_THAT(admission_.CheckPlaces(), IsOk());
  EXPECT_EQ(admission_.load().sessions, 2);
  EXPECT_THAT(admission_.Admit({Memory(1)}), IsOk());
}

TEST_F(AdmissionTest, RefusesASessionWhoseFeaturesDoNotFit) {
  auto first = admission_.Admit({Memory(600)});
  EXPECT_GT(OverloadDetails(admission_.Admit({Memory(500)}).status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(OverloadDetails(admission_.Admit({Memory(1001)}).status())->retry_after, absl::ZeroDuration())
      << "it will never fit";
  EXPECT_THAT(admission_.Admit({Memory(400)}), IsOk());
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kMemory], 2);
}

TEST_F(AdmissionTest, RefusesWorkBeyondTheBudgetAndNamesBoth) {
  auto first = admission_.Admit({Work(10, 50, true)});  // 10 x (10 + 50)
  ASSERT_THAT(first, IsOk());
  EXPECT_DOUBLE_EQ(admission_.load().work, 600);
  const auto second = admission_.Admit({Work(10, 31, true)});
  EXPECT_EQ(Refusal(second.status()), "point-frames per second");
  EXPECT_THAT(second.status().message(), HasSubstr("needs 410, and 600 of 1000 are promised"));
  EXPECT_GT(OverloadDetails(second.status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kWork], 1);
  EXPECT_THAT(admission_.Admit({Work(10, 30, true)}), IsOk()) << "and its ticket goes back at once";
  EXPECT_DOUBLE_EQ(metrics_.totals().work_promised, 600);
  first->reset();
  EXPECT_EQ(admission_.load().work, 0);
  EXPECT_THAT(admission_.Admit({Work(10, 31, true)}), IsOk());
}

TEST_F(AdmissionTest, AloneASessionIsServedAtAnyPaceUnlessItInsistsOnOne) {
  EXPECT_THAT(admission_.Admit({Work(1, 2000, false)}), IsOk());
  const auto insists = admission_.Admit({Work(1, 2000, true)});
  EXPECT_EQ(Refusal(insists.status()), "point-frames per second");
  EXPECT_EQ(OverloadDetails(insists.status())->retry_after, absl::ZeroDuration()) << "it will never fit";
  auto other = admission_.Admit({Work(1, 1, false)});
  EXPECT_EQ(Refusal(admission_.Admit({Work(1, 2000, false)}).status()), "point-frames per second");
}

TEST_F(AdmissionTest, MeetsTheFirstDemandWhoseWorkFitsAndRefusesForTheLast) {
  const Admission::Demand demand = Work(10, 120, true);  // 10 x (10 + 120 / hop): 700, 500, 400, 340 from hop 2 on
  EXPECT_EQ((*admission_.Admit(Hops(2, 5, demand)))->choice(), 0u) << "nobody else is there";
  auto other = *admission_.Admit({Work(10, 50, true)});  // leaves 400
  EXPECT_EQ(other->choice(), 0u);
  auto chosen = *admission_.Admit(Hops(2, 5, demand));
  EXPECT_EQ(chosen->choice(), 2u);
  EXPECT_DOUBLE_EQ(admission_.load().work, 1000);
  chosen.reset();
  EXPECT_DOUBLE_EQ(admission_.load().work, 600);
  const auto refused = admission_.Admit(Hops(2, 3, demand));
  EXPECT_THAT(refused.status().message(), HasSubstr("needs 500, and 600 of 1000 are promised"));
  EXPECT_GT(OverloadDetails(refused.status())->retry_after, absl::ZeroDuration());
  EXPECT_EQ(metrics_.totals().rejected[RejectReason::kWork], 1) << "once for all of them";
  const auto never = admission_.Admit(Hops(2, 3, Work(30, 120, true)));  // 1500 at least
  EXPECT_EQ(OverloadDetails(never.status())->retry_after, absl::ZeroDuration());
}

TEST_F(AdmissionTest, WhoNamesNoRateGetsTheFirstDemandWhileThatWouldBeTakenAtAll) {
  const Admission::Demand demand = Work(0.5, 120, false);  // 35 and 25 with hops 2 and 3
  EXPECT_EQ((*admission_.Admit(Hops(2, 3, demand)))->choice(), 0u);
  auto other = *admission_.Admit({Work(10, 86, true)});  // leaves 40
  auto first = *admission_.Admit(Hops(2, 3, demand));
  EXPECT_EQ(first->choice(), 0u);
  first.reset();
  other->SetPoints(87);  // leaves 30
  EXPECT_EQ((*admission_.Admit(Hops(2, 3, demand)))->choice(), 1u);
}

TEST_F(AdmissionTest, TheMemoryOfTheChosenDemandHasToFit) {
  const Admission::Demand demand = Work(10, 120, true);
  Admission::Demand large = Work(10, 50, true);
  large.bytes = 700;
  auto other = *admission_.Admit({large});
  ASSERT_DOUBLE_EQ(admission_.load().work, 600);
  const auto refused = admission_.Admit(Hops(2, 5, demand));  // 400 bytes with hop 4, and 300 are left
  EXPECT_EQ(Refusal(refused.status()), "feature memory");
  EXPECT_GT(OverloadDetails(refused.status())->retry_after, absl::ZeroDuration()) << "a smaller hop fits one day";
  other.reset();
  EXPECT_THAT(admission_.Admit(Hops(2, 5, demand)), IsOk());
}

TEST_F(AdmissionTest, PointsThatComeLaterCountAsSoonAsTheyAreMoreThanWasAskedFor) {
  auto ticket = *admission_.Admit({Work(10, 20, true)});
  ticket->SetPoints(5);
  EXPECT_DOUBLE_EQ(admission_.load().work, 300);
  EXPECT_EQ(admission_.load().points, 5);
  ticket->SetPoints(60);
  EXPECT_DOUBLE_EQ(admission_.load().work, 700);
  EXPECT_EQ(Refusal(admission_.Admit({Work(10, 21, true)}).status()), "point-frames per second");
  ticket->SetPoints(0);
  EXPECT_DOUBLE_EQ(admission_.load().work, 300);
  EXPECT_THAT(admission_.Admit({Work(10, 21, true)}), IsOk());
}

TEST_F(AdmissionTest, ACrowdedMachineTakesFewerAndSaysWhenToComeBack) {
  auto first = *admission_.Admit({Work(10, 20, true)});
  for (int i = 0; i < 20; ++i) meter_.Refined(1000, 1, absl::Seconds(2));  // one second at warm-up
  const auto refused = admission_.Admit({Work(10, 20, true)});
  EXPECT_EQ(Refusal(refused.status()), "point-frames per second");
  EXPECT_GT(OverloadDetails(refused.status())->retry_after, absl::ZeroDuration());
  clock_.Advance(absl::Minutes(5));
  EXPECT_THAT(admission_.Admit({Work(10, 20, true)}), IsOk());
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
