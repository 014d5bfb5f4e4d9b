// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/engine/evidence.h"
#include "server/engine/tracks/calibration.h"

namespace holdfast {

// By the network's word a point is visible above this.
constexpr float kVisibleAbove = 0.5f;
// By a calibrated confidence, which is of being visible and right. Low, as many visible points are followed coarsely:
// on annotated video the share of right verdicts falls above it, while what is below is hidden or lost.
constexpr float kCalibratedVisibleAbove = 0.1f;

// From a visibility head: the logistic function of its logit, in [0, 1].
float ConfidenceFromLogit(float logit);

// For models without a visibility head, in [0, 1]: the template must look like what is found at the estimate, and the
// refinement must have come to rest. 'similarity' is a cosine: up to 0.1 counts as nothing, from 0.9 on as certain,
// linear between. 'last_step' (feature pixels moved in the last iteration) halves the result at one feature pixel and
// hardly matters below a tenth. NaN gives 0.
float ConfidenceFromMatch(float similarity, float last_step);

// What the network alone says about the point being visible, in [0, 1]: by its visibility head or, without one, by the
// match.
float NetworkConfidence(const Evidence& evidence);

// Whoever is less sure than this of a point counts it as lost: it is looked for, see SessionFlow.
constexpr float kDoubtBelow = 0.6f;

// How the estimates of a session are judged.
struct ConfidenceRule {
  const Calibration* calibration = nullptr;  // null: the checkpoint has none, the network's word stands
  const EvidenceSink* sink = nullptr;        // null: nobody wants to hear
  // A point inside the frame is reported as visible above this confidence.
  float visible_above() const { return calibration == nullptr ? kVisibleAbove : kCalibratedVisibleAbove; }
  float Confidence(const Evidence& evidence) const {
    return calibration == nullptr ? NetworkConfidence(evidence) : calibration->Confidence(evidence);
  }
  // How sure it is that the point is not lost, by the window alone: neither polish, which may come later, has a say,
  // nor that errors have had time to add up since the query, after the first few windows.
  float Assurance(Evidence evidence) const;
};

}  // namespace holdfast
