// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "server/engine/deformation.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

// A place where the surroundings of a query were found again. All of it is finite.
struct Alignment {
  FlowPoint at;
  Deformation deformation;  // plausible
  float correlation = 0;    // of the surroundings' brightness here and there, 1 at most
};

// Looks for the patch near 'start', turned, scaled and sheared about as 'deformation' says. Brighter or darker, with
// more or less contrast, it is the same. Empty where it has hardly any texture or the search leads nowhere plausible.
// On pictures of half the size, which have less noise and a wider view: inverse compositional alignment (Baker and
// Matthews, "Lucas-Kanade 20 Years On", 2004) of affine maps.
std::optional<Alignment> AlignPatch(const FlowPatch& patch, const FlowPyramid& picture, FlowPoint start,
                                    const Deformation& deformation);

}  // namespace holdfast
