// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/calibration_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/status_matchers.h"
#include "training/evaluation/reliability.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using Polish = Evidence::Polish;

// Evidence of which nothing but the constant is other than 0.
Evidence Blank(Polish polish = Polish::kNotTried) {
  Evidence evidence;
  evidence.visibility_logit = 0;
  evidence.similarity = 0;
  evidence.polish = polish;
  return evidence;
}

// Draws evidence at random, and whether the estimate is right as a calibration says.
class Law {
 public:
  Law(const Calibration& calibration, uint32_t seed) : calibration_(calibration), random_(seed) {}

  std::vector<Judged> Draw(int count) {
    std::vector<Judged> drawn;
    for (int i = 0; i < count; ++i) {
      Evidence evidence;
      evidence.visibility_logit = Uniform(-4, 4);
      evidence.similarity = Uniform(-1, 1);
      evidence.last_step = Uniform(0, 3);
      evidence.age = static_cast<int64_t>(Uniform(0, 100));
      drawn.push_back({evidence, Uniform(0, 1) < calibration_.Confidence(evidence)});
    }
    return drawn;
  }

 private:
  // The same numbers whatever the library's distributions do.
  float Uniform(float low, float high) {
    return low + (high - low) * static_cast<float>(random_() >> 8) / static_cast<float>(1 << 24);
  }
  const Calibration calibration_;
  std::mt19937 random_;
};

Calibration KnownLaw() { return Calibration({-1, 0.75, 0, 2, -1.5, 0.25, 0, 0, 0}); }

std::vector<Claim> ClaimsBy(const Calibration& calibration, const std::vector<Judged>& observed) {
  std::vector<Claim> claims;
  claims.reserve(observed.size());
  for (const Judged& judged : observed) claims.push_back({0, calibration.Confidence(judged.evidence), judged.right});
  return claims;
}

// 'right' of 'count' estimates are right.
void Add(const Evidence& evidence, int right, int count, std::vector<Judged>& observed) {
  for (int i = 0; i < count; ++i) observed.push_back({evidence, i < right});
}

TEST(CalibrationFitTest, FindsTheLawThatTheDataFollow) {
  const auto fitted = FitCalibration(Law(KnownLaw(), /*seed=*/1).Draw(100000));
  ASSERT_THAT(fitted, IsOk());
  // About the standard deviation of the constant, which is hard to tell from the age; others are closer.
  for (size_t i = 0; i < Calibration::kFeatures; ++i) {
    EXPECT_NEAR(fitted->weights()[i], KnownLaw().weights()[i], 0.05) << Calibration::FeatureNames()[i];
  }
}

TEST(CalibrationFitTest, IsReliableOnOtherDataOfTheSameLaw) {
  const auto fitted = FitCalibration(Law(KnownLaw(), /*seed=*/1).Draw(5000));
  ASSERT_THAT(fitted, IsOk());
  const std::vector<Judged> others = Law(KnownLaw(), /*seed=*/2).Draw(20000);
  const auto reliability = ComputeReliability(ClaimsBy(*fitted, others));
  const auto best = ComputeReliability(ClaimsBy(KnownLaw(), others));
  EXPECT_LT(reliability->ece, 0.02);
  EXPECT_LT(reliability->brier, best->brier + 0.002);
  EXPECT_GT(*reliability->auc, *best->auc - 0.002);
}

TEST(CalibrationFitTest, EqualEvidenceGetsTheShareThatIsRight) {
  std::vector<Judged> observed;
  Add({}, 1, 4, observed);
  const auto fitted = FitCalibration(observed);
  ASSERT_THAT(fitted, IsOk());
  EXPECT_NEAR(fitted->Confidence({}), 0.25, 1e-3);
}

TEST(CalibrationFitTest, APolishedEstimateCountsAsItWasBeforeToo) {
  std::vector<Judged> observed;
  Add(Blank(Polish::kFromQuery), 3, 4, observed);
  Add(Blank(Polish::kNotFound), 1, 4, observed);
  const auto fitted = FitCalibration(observed);
  ASSERT_THAT(fitted, IsOk());
  EXPECT_NEAR(fitted->Confidence(Blank(Polish::kFromQuery)), 0.75, 1e-3);
  EXPECT_NEAR(fitted->Confidence(Blank(Polish::kNotFound)), 0.25, 1e-3);
  EXPECT_NEAR(fitted->Confidence(Blank()), 0.5, 1e-3) << "half of what was not yet polished was right";
}

TEST(CalibrationFitTest, AnEstimateThatWasNotPolishedCountsOnce) {
  std::vector<Judged> observed;
  Add(Blank(), 6, 8, observed);                     // hidden by the network's word
  Add(Blank(Polish::kFromBefore), 0, 4, observed);  // and those 4 before they were polished
  const auto fitted = FitCalibration(observed);
  ASSERT_THAT(fitted, IsOk());
  EXPECT_NEAR(fitted->Confidence(Blank()), 0.5, 1e-2) << "6 of 8 + 4";
  EXPECT_LT(fitted->Confidence(Blank(Polish::kFromBefore)), 0.05);
}

TEST(CalibrationFitTest, WhatNeverOccursHasNoWeight) {
  const auto fitted = FitCalibration(Law(KnownLaw(), /*seed=*/3).Draw(500));
  ASSERT_THAT(fitted, IsOk());
  for (const size_t feature : {2, 6, 7, 8}) {
    EXPECT_NEAR(fitted->weights()[feature], 0, 1e-9) << Calibration::FeatureNames()[feature];
  }
}

TEST(CalibrationFitTest, WithoutSomeThatAreRightAndSomeThatAreWrongThereIsNothingToLearn) {
  std::vector<Judged> all_right, all_wrong;
  Add(Blank(), 3, 3, all_right);
  Add(Blank(), 0, 2, all_wrong);
  constexpr auto kCannot = absl::StatusCode::kFailedPrecondition;
  EXPECT_THAT(FitCalibration(all_right), StatusIs(kCannot, HasSubstr("3 of 3 estimates are right")));
  EXPECT_THAT(FitCalibration(all_wrong), StatusIs(kCannot, HasSubstr("0 of 2 estimates are right")));
  EXPECT_THAT(FitCalibration({}), StatusIs(kCannot, HasSubstr("0 of 0 estimates are right")));
}

TEST(CalibrationFitTest, DataThatCanBeToldApartWithoutErrorGiveWeightsThatCanBeStored) {
  std::vector<Judged> observed;
  for (const float logit : {-9.0f, -3.0f, -0.5f, 0.5f, 3.0f, 9.0f}) {
    Evidence evidence = Blank();
    evidence.visibility_logit = logit;
    Add(evidence, logit > 0 ? 5 : 0, 5, observed);
  }
  const auto fitted = FitCalibration(observed);
  ASSERT_THAT(fitted, IsOk());
  EXPECT_THAT(Calibration::FromJson(fitted->ToJson()), IsOk());
  for (const Judged& judged : observed) {
    EXPECT_EQ(fitted->Confidence(judged.evidence) > 0.5f, judged.right) << judged.evidence.visibility_logit;
  }
  EXPECT_GT(fitted->Confidence(observed.back().evidence), 0.99f);
}

TEST(CalibrationFitTest, EvidenceThatIsNoNumberDoesNotSpoilTheFit) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  std::vector<Judged> observed = Law(KnownLaw(), /*seed=*/4).Draw(500);
  for (const float wild : {nan, infinity, -infinity}) {
    Evidence evidence;
    evidence.visibility_logit = evidence.similarity = evidence.last_step = wild;
    evidence.age = std::numeric_limits<int64_t>::max();
    Add(evidence, 1, 2, observed);
  }
  const auto fitted = FitCalibration(observed);
  ASSERT_THAT(fitted, IsOk());
  EXPECT_THAT(Calibration::FromJson(fitted->ToJson()), IsOk());
}

}  // namespace
}  // namespace holdfast
