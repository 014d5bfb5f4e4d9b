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

TEST(ConfidenceTest, TheNetworksWordIsItsVisibilityHeads) {
  Evidence evidence;
  evidence.visibility_logit = std::log(3.0f);
  evidence.similarity = -1;  // nothing counts beside the head
  evidence.last_step = 8;
  EXPECT_FLOAT_EQ(NetworkConfidence(evidence), 0.75f);
}

TEST(ConfidenceTest, WithoutAHeadTheNetworksWordIsTheMatch) {
  Evidence evidence;
  evidence.similarity = 0.5f;
  evidence.last_step = 1;
  EXPECT_FLOAT_EQ(NetworkConfidence(evidence), 0.25f);
  evidence.age = 1000;
  evidence.polish = Evidence::Polish::kFromQuery;
  EXPECT_FLOAT_EQ(NetworkConfidence(evidence), 0.25f) << "the network knows neither";
}

TEST(ConfidenceTest, WithoutACalibrationTheNetworksWordStands) {
  Evidence evidence;
  evidence.visibility_logit = std::log(3.0f);
  EXPECT_EQ(ConfidenceRule().Confidence(evidence), NetworkConfidence(evidence));
  evidence.polish = Evidence::Polish::kNotFound;
  EXPECT_FLOAT_EQ(ConfidenceRule().Confidence(evidence), 0.75f);
}

TEST(ConfidenceTest, ACalibrationDecidesWhereThereIsOne) {
  Evidence evidence;
  evidence.visibility_logit = 20;
  evidence.polish = Evidence::Polish::kNotFound;
  const Calibration calibration({0, 0, 0, 0, 0, 0, 0, 0, -std::log(3.0)});  // not_found alone counts
  const ConfidenceRule rule{&calibration, nullptr};
  EXPECT_FLOAT_EQ(rule.Confidence(evidence), 0.25f);
  evidence.polish = Evidence::Polish::kFromQuery;
  EXPECT_EQ(rule.Confidence(evidence), 0.5f);
}

TEST(ConfidenceTest, WhatIsProbablyLostIsStillVisibleWhereConfidenceIsCalibrated) {
  const Calibration calibration({0});
  EXPECT_EQ(ConfidenceRule().visible_above(), 0.5f);
  EXPECT_EQ((ConfidenceRule{&calibration, nullptr}.visible_above()), 0.1f);
}

TEST(ConfidenceTest, WhetherAPointIsLostIsJudgedWithoutPolishAndWithoutTheYears) {
  Calibration::Features weights{};
  weights[0] = 3;
  weights[5] = -0.25;  // age
  weights[6] = 1;      // polish: found
  weights[8] = -2;     // not found
  const Calibration calibration(weights);
  const ConfidenceRule rule{&calibration};
  Evidence evidence;
  evidence.age = 40;
  EXPECT_EQ(rule.Assurance(evidence), rule.Confidence(evidence));
  evidence.polish = Evidence::Polish::kNotFound;
  EXPECT_GT(rule.Assurance(evidence), rule.Confidence(evidence));
  evidence.age = 1'000'000;  // nine hours
  evidence.polish = Evidence::Polish::kFromQuery;
  EXPECT_GT(rule.Assurance(evidence), 0.8f);
  EXPECT_LT(rule.Confidence(evidence), 0.8f);
}

}  // namespace
}  // namespace holdfast
