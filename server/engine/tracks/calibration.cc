// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/calibration.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "io/bounded_json.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

constexpr int kVersion = 1;
constexpr double kMaxLogit = 12;    // beyond it a network's word is as good as certain
constexpr double kMaxStep = 64;     // feature pixels
constexpr double kMaxAge = 1e6;     // frames
constexpr double kMaxWeight = 1e3;  // a fitted one is far below

// NaN counts as 'otherwise'.
double Bounded(double value, double low, double high, double otherwise) {
  return std::isnan(value) ? otherwise : std::clamp(value, low, high);
}

absl::Status Bad(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("calibration of confidence: ", what));
}

}  // namespace

const std::array<const char*, Calibration::kFeatures>& Calibration::FeatureNames() {
  static constexpr std::array<const char*, kFeatures> kNames = {"constant",   "visibility_logit", "no_logit",
                                                                "similarity", "last_step",        "age",
                                                                "from_query", "from_before",      "not_found"};
  return kNames;
}

Calibration::Features Calibration::FeaturesOf(const Evidence& evidence) {
  const auto is = [&](Evidence::Polish polish) { return evidence.polish == polish ? 1.0 : 0.0; };
  return {1,
          Bounded(evidence.visibility_logit, -kMaxLogit, kMaxLogit, 0),
          std::isnan(evidence.visibility_logit) ? 1.0 : 0.0,
          Bounded(evidence.similarity, -1, 1, -1),
          std::log1p(Bounded(evidence.last_step, 0, kMaxStep, kMaxStep)),
          std::log1p(Bounded(static_cast<double>(evidence.age), 0, kMaxAge, 0)),
          is(Evidence::Polish::kFromQuery),
          is(Evidence::Polish::kFromBefore),
          is(Evidence::Polish::kNotFound)};
}

absl::StatusOr<Calibration> Calibration::FromJson(absl::string_view json) {
  const absl::StatusOr<nlohmann::json> parsed = ParseBoundedJson(json, {});
  if (!parsed.ok()) return Bad(parsed.status().message());
  if (!parsed->is_object() || parsed->value("version", nlohmann::json()) != kVersion) {
    return Bad(absl::StrCat("expected an object with version ", kVersion));
  }
  const auto found = parsed->find("weights");
  if (found == parsed->end() || !found->is_object()) return Bad("expected an object 'weights'");
  Features weights{};
  for (size_t i = 0; i < kFeatures; ++i) {
    const auto weight = found->find(FeatureNames()[i]);
    if (weight == found->end() || !weight->is_number()) return Bad(absl::StrCat("no weight ", FeatureNames()[i]));
    weights[i] = weight->get<double>();
    if (!(std::abs(weights[i]) <= kMaxWeight)) {
      return Bad(absl::StrCat("weight ", FeatureNames()[i], ": ", weights[i], " is beyond ", kMaxWeight));
    }
  }
  if (found->size() == kFeatures) return Calibration(weights);
  for (const auto& [name, weight] : found->items()) {
    const auto& known = FeatureNames();
    if (std::find(known.begin(), known.end(), name) == known.end())
      return Bad(absl::StrCat("unknown weight ", Quoted(name)));
  }
  return Calibration(weights);
}

std::string Calibration::ToJson() const {
  nlohmann::ordered_json weights = nlohmann::ordered_json::object();
  for (size_t i = 0; i < kFeatures; ++i) weights[FeatureNames()[i]] = weights_[i];
  return nlohmann::ordered_json{{"version", kVersion}, {"weights", weights}}.dump();
}

float Calibration::Confidence(const Evidence& evidence) const {
  const Features features = FeaturesOf(evidence);
  double sum = 0;
  for (size_t i = 0; i < kFeatures; ++i) sum += weights_[i] * features[i];
  return static_cast<float>(1 / (1 + std::exp(-sum)));
}

}  // namespace holdfast
