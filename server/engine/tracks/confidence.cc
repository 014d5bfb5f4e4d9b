// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/confidence.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace holdfast {

namespace {

constexpr int64_t kMostAge = 96;  // frames

}  // namespace

float ConfidenceFromLogit(float logit) { return std::isnan(logit) ? 0.0f : 1.0f / (1.0f + std::exp(-logit)); }

float ConfidenceFromMatch(float similarity, float last_step) {
  if (std::isnan(similarity) || std::isnan(last_step)) return 0.0f;
  const float likeness = std::clamp((similarity - 0.1f) / 0.8f, 0.0f, 1.0f);
  return likeness / (1.0f + last_step * last_step);
}

float NetworkConfidence(const Evidence& evidence) {
  return std::isnan(evidence.visibility_logit) ? ConfidenceFromMatch(evidence.similarity, evidence.last_step)
                                               : ConfidenceFromLogit(evidence.visibility_logit);
}

float ConfidenceRule::Assurance(Evidence evidence) const {
  evidence.polish = Evidence::Polish::kNotTried;
  evidence.age = std::min(evidence.age, kMostAge);
  return Confidence(evidence);
}

}  // namespace holdfast
