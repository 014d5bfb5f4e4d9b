// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/objects/object_state.h"

namespace holdfast {

struct Displacement {
  Pixel from;
  Pixel to;
};

double Distance(Pixel a, Pixel b);

// The similarity that the most displacements agree with, to 'tolerance' pixels of where they lead; empty where there is
// none that enough of them do (three, and three in ten). 'guess' is tried first. A function of its arguments alone: no
// chance, the order of the displacements aside.
std::optional<Similarity> FitSimilarity(absl::Span<const Displacement> displacements, double tolerance,
                                        const Similarity& guess);

}  // namespace holdfast
