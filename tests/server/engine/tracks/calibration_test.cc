// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Polish = Evidence::Polish;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

Evidence MakeEvidence(float logit, float similarity, float last_step, int64_t age, Polish polish) {
  Evidence evidence;
  evidence.visibility_logit = logit;
  evidence.similarity = similarity;
  evidence.last_step = last_step;
  evidence.age = age;
  evidence.polish = polish;
  return evidence;
}

// A calibration that is sound but for what 'changed' says of its weights; an empty text leaves the weight out.
std::string TextWith(const std::map<std::string, std::string>& changed) {
  std::map<std::string, std::string> weights;
  for (const char* name : Calibration::FeatureNames()) weights[name] = "0.5";
  for (const auto& [name, value] : changed) weights[name] = value;
  std::string text;
  for (const auto& [name, value] : weights) {
    if (!value.empty()) absl::StrAppend(&text, text.empty() ? "" : ", ", "\"", name, "\": ", value);
  }
  return absl::StrCat("{\"version\": 1, \"weights\": {", text, "}}");
}

// Only this feature counts.
Calibration Only(size_t feature, double weight = 1) {
  Calibration::Features weights{};
  weights[feature] = weight;
  return Calibration(weights);
}

double Logistic(double x) { return 1 / (1 + std::exp(-x)); }

// Evidence as no network should give it, in every member.
std::vector<Evidence> WildEvidence() {
  const float most = std::numeric_limits<float>::max(), least = std::numeric_limits<float>::denorm_min();
  std::vector<Evidence> all;
  for (const float wild : {kNan, kInfinity, -kInfinity, most, -most, least, 0.0f}) {
    for (const int64_t age : {std::numeric_limits<int64_t>::min(), int64_t{-1}, std::numeric_limits<int64_t>::max()}) {
      all.push_back(MakeEvidence(wild, 1, 0, age, Polish::kNotTried));
      all.push_back(MakeEvidence(0, wild, 0, age, Polish::kFromQuery));
      all.push_back(MakeEvidence(0, 1, wild, age, Polish::kFromBefore));
      all.push_back(MakeEvidence(wild, wild, wild, age, Polish::kNotFound));
    }
  }
  return all;
}

TEST(CalibrationTest, JsonGivesTheVeryWeightsBack) {
  const Calibration::Features weights = {0.1, 1.0 / 3, -2.0 / 7, 1e-300, -1000, 1000, 0, 123.456789012345678, -1e-17};
  const auto read = Calibration::FromJson(Calibration(weights).ToJson());
  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(read->weights(), weights);
  EXPECT_EQ(read->ToJson(), Calibration(weights).ToJson());
}

TEST(CalibrationTest, JsonNamesEveryWeightInTheOrderOfTheFeatures) {
  EXPECT_EQ(Calibration({1, 2, 3, 4, 5, 6, 7, 8, 9}).ToJson(),
            R"({"version":1,"weights":{"constant":1.0,"visibility_logit":2.0,"no_logit":3.0,"similarity":4.0,)"
            R"("last_step":5.0,"age":6.0,"from_query":7.0,"from_before":8.0,"not_found":9.0}})");
}

TEST(CalibrationTest, ReadsWeightsByNameAndIntegersToo) {
  const auto read = Calibration::FromJson(TextWith({{"age", "-3"}, {"constant", "1000"}}));
  ASSERT_THAT(read, IsOk());
  EXPECT_THAT(read->weights(), ElementsAre(1000, 0.5, 0.5, 0.5, 0.5, -3, 0.5, 0.5, 0.5));
}

TEST(CalibrationTest, WhatIsNotJsonIsRefused) {
  for (const char* text : {"", "weights", "{\"version\": 1", "{\"version\": 1, \"version\": 1}"}) {
    EXPECT_THAT(Calibration::FromJson(text), StatusIs(kInvalid, HasSubstr("calibration of confidence: JSON: ")))
        << text;
  }
}

TEST(CalibrationTest, AnotherVersionIsRefused) {
  for (const char* text :
       {"{}", "[1]", "1", "null", R"({"version": 2, "weights": {}})", R"({"version": "1", "weights": {}})",
        R"({"version": true, "weights": {}})", R"({"version": null, "weights": {}})"}) {
    EXPECT_THAT(Calibration::FromJson(text),
                StatusIs(kInvalid, HasSubstr("calibration of confidence: expected an object with version 1")))
        << text;
  }
}

TEST(CalibrationTest, WeightsAreNeeded) {
  for (const char* text : {R"({"version": 1})", R"({"version": 1, "weights": [0.5]})",
                           R"({"version": 1, "weights": null})", R"({"version": 1, "weights": 3})"}) {
    EXPECT_THAT(Calibration::FromJson(text), StatusIs(kInvalid, HasSubstr("expected an object 'weights'"))) << text;
  }
}

TEST(CalibrationTest, AMissingWeightIsNamed) {
  for (const char* name : Calibration::FeatureNames()) {
    EXPECT_THAT(Calibration::FromJson(TextWith({{name, ""}})),
                StatusIs(kInvalid, HasSubstr(absl::StrCat("no weight ", name))));
  }
}

TEST(CalibrationTest, AnUnknownWeightIsNamed) {
  EXPECT_THAT(Calibration::FromJson(TextWith({{"colour", "0.5"}})),
              StatusIs(kInvalid, HasSubstr("unknown weight 'colour'")));
  EXPECT_THAT(Calibration::FromJson(TextWith({{"colour", "0.5"}, {"age", ""}})),
              StatusIs(kInvalid, HasSubstr("no weight age")))
      << "an unknown one does not stand for a missing one";
}

TEST(CalibrationTest, AWeightThatIsNoNumberIsNamed) {
  for (const char* value : {"\"0.5\"", "\"NaN\"", "null", "true", "[0.5]", "{}"}) {
    EXPECT_THAT(Calibration::FromJson(TextWith({{"last_step", value}})),
                StatusIs(kInvalid, HasSubstr("no weight last_step")))
        << value;
  }
}

TEST(CalibrationTest, NotANumberAndInfinityAreNotEvenJson) {
  for (const char* value : {"NaN", "nan", "-nan", "Infinity", "-Infinity", "1e999"}) {
    EXPECT_THAT(Calibration::FromJson(TextWith({{"last_step", value}})), StatusIs(kInvalid, HasSubstr("syntax error")))
        << value;
  }
  EXPECT_THAT(Calibration::FromJson(Calibration({kNan}).ToJson()), StatusIs(kInvalid, HasSubstr("no weight constant")));
}

TEST(CalibrationTest, ABadWeightIsNamed) {
  for (const char* value : {"1000.5", "-1001", "1e300", "18446744073709551615"}) {
    EXPECT_THAT(Calibration::FromJson(TextWith({{"from_before", value}})),
                StatusIs(kInvalid, AllOf(HasSubstr("weight from_before: "), HasSubstr("is beyond 1000"))))
        << value;
  }
}

TEST(CalibrationTest, ATextThatIsTooLongIsRefused) {
  const std::string text = TextWith({}) + std::string(size_t{64} << 10, ' ');
  EXPECT_THAT(Calibration::FromJson(text), StatusIs(kInvalid, HasSubstr("at most 65536")));
}

TEST(CalibrationTest, EveryFeatureComesFromItsMember) {
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(1.5f, 0.25f, 3, 7, Polish::kNotTried)),
              ElementsAre(1, 1.5, 0, 0.25, std::log(4.0), std::log(8.0), 0, 0, 0));
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(kNan, -0.5f, 0, 0, Polish::kFromQuery)),
              ElementsAre(1, 0, 1, -0.5, 0, 0, 1, 0, 0));
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(-2, 1, 0, 0, Polish::kFromBefore)),
              ElementsAre(1, -2, 0, 1, 0, 0, 0, 1, 0));
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(-2, 1, 0, 0, Polish::kNotFound)),
              ElementsAre(1, -2, 0, 1, 0, 0, 0, 0, 1));
}

TEST(CalibrationTest, FeaturesAreBounded) {
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(1000, 7, 1e9f, 1 << 30, Polish::kNotTried)),
              ElementsAre(1, 12, 0, 1, std::log(65.0), std::log(1e6 + 1), 0, 0, 0));
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(-kInfinity, -7, -1, -1, Polish::kNotTried)),
              ElementsAre(1, -12, 0, -1, 0, 0, 0, 0, 0));
}

TEST(CalibrationTest, AMatchThatIsNotANumberCountsAsTheWorst) {
  EXPECT_THAT(Calibration::FeaturesOf(MakeEvidence(0, kNan, kNan, 0, Polish::kNotTried)),
              ElementsAre(1, 0, 0, -1, std::log(65.0), 0, 0, 0, 0));
}

TEST(CalibrationTest, FeaturesAreFiniteWhateverTheEvidence) {
  for (const Evidence& evidence : WildEvidence()) {
    for (const double feature : Calibration::FeaturesOf(evidence)) {
      EXPECT_TRUE(std::isfinite(feature));
      EXPECT_LE(std::abs(feature), 14);
    }
  }
}

TEST(CalibrationTest, ConfidenceIsTheLogisticFunctionOfTheWeighedFeatures) {
  // -1 + 2 * 0.5 + 4 * 0.25 - log(2) - 0.5 * log(4) + log(3) - 1 = log(3 / 4).
  const Calibration calibration({-1, 2, 100, 4, -1, -0.5, std::log(3.0) - 1, 100, 100});
  EXPECT_FLOAT_EQ(calibration.Confidence(MakeEvidence(0.5f, 0.25f, 1, 3, Polish::kFromQuery)), 3.0f / 7);
  EXPECT_EQ(Calibration(Calibration::Features{}).Confidence({}), 0.5f);
}

TEST(CalibrationTest, EveryWeightWeighsItsFeature) {
  const Evidence evidence = MakeEvidence(1.5f, 0.25f, 3, 7, Polish::kFromBefore);
  const Calibration::Features features = Calibration::FeaturesOf(evidence);
  for (size_t i = 0; i < Calibration::kFeatures; ++i) {
    EXPECT_FLOAT_EQ(Only(i, 0.5).Confidence(evidence), static_cast<float>(Logistic(0.5 * features[i]))) << i;
  }
}

TEST(CalibrationTest, ConfidenceGrowsWithTheLogitWhereItsWeightIsPositive) {
  const Calibration calibration({0.25, 0.5, -1, 2, -0.5, -0.125, 1, 0.5, -1});
  float before = -1;
  for (int half = -28; half <= 28; ++half) {
    const float logit = 0.5f * static_cast<float>(half);
    const float confidence = calibration.Confidence(MakeEvidence(logit, 0.5f, 1, 30, Polish::kNotFound));
    if (logit > -12 && logit <= 12) {
      EXPECT_GT(confidence, before) << logit;
    } else {
      EXPECT_GE(confidence, before) << logit << " is beyond what counts";
    }
    before = confidence;
  }
}

TEST(CalibrationTest, ConfidenceStaysBetweenNothingAndCertainty) {
  Calibration::Features high, low;
  high.fill(1000);
  low.fill(-1000);
  for (const Evidence& evidence : WildEvidence()) {
    for (const Calibration& calibration : {Calibration(high), Calibration(low), Only(1, 1000), Only(3, -1000)}) {
      const float confidence = calibration.Confidence(evidence);
      EXPECT_TRUE(confidence >= 0 && confidence <= 1) << confidence;
    }
  }
}

}  // namespace
}  // namespace holdfast
