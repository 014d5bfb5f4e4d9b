// SPDX-License-Identifier: Apache-2.0
// Whether confidences mean what they say. Plain C++.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "training/evaluation/metrics.h"

namespace holdfast {

// An estimate is right when the point is visible and less than this far from it, in pixels of a 256x256 frame.
constexpr double kRightWithin = 8;

struct Claim {
  int64_t index = 0;     // ScoredVideo::Index of the frame and point
  float confidence = 0;  // that the estimate is right
  bool right = false;    // by the truth
};

// Those of all frames after the points' queries for which there is a truth, and of those whose points are hidden nobody
// knows where: there every claim is wrong. None without confidences.
std::vector<Claim> ClaimsOf(const ScoredVideo& video);

struct ReliabilityBin {  // claims whose confidence is in one tenth of [0, 1]
  int64_t claims = 0;
  double confidence = 0;  // mean
  double right = 0;       // share of those that are right
};

struct Reliability {
  int64_t claims = 0;
  double ece = 0;             // expected calibration error: |confidence - right| of the bins, weighed by their claims
  double brier = 0;           // mean of (confidence - right)^2
  std::optional<double> auc;  // probability that a right claim is above a wrong one; empty: there is but one kind
  std::array<ReliabilityBin, 10> bins;
};

// Empty: there are no claims.
std::optional<Reliability> ComputeReliability(const std::vector<Claim>& claims);

}  // namespace holdfast
