// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

// A point counts as visible above this confidence, when it is inside the frame.
constexpr float kVisibleAbove = 0.5f;

// From a visibility head: the logistic function of its logit, in [0, 1].
float ConfidenceFromLogit(float logit);

// For models without a visibility head, in [0, 1]: the template must look like what is found at the estimate, and the
// refinement must have come to rest. 'similarity' is a cosine: up to 0.1 counts as nothing, from 0.9 on as certain,
// linear between. 'last_step' (feature pixels moved in the last iteration) halves the result at one feature pixel and
// hardly matters below a tenth. NaN gives 0.
float ConfidenceFromMatch(float similarity, float last_step);

}  // namespace holdfast
