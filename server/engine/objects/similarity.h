// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
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

struct FittedSimilarity {
  Similarity motion;
  size_t agree = 0;  // displacements that it was fitted to
};

// How many pixels of where a similarity leads a displacement may lie for agreeing with it. They shrink with what is
// mapped: a similarity of a small scale leads everywhere to the same place, and whatever gathers there would agree.
struct Tolerance {
  double share = 0;  // of distances before the similarity; pixels at scale 1
  double least = 0;  // pixels at the scale before
  double before = 1;

  double Of(const Similarity& motion) const;
};

// The similarity that the most displacements agree with, each to its own tolerance; empty where no three do. Any two
// define one exactly, so of displacements that have nothing in common a few agree by chance: whether those that do are
// enough is the caller's to say. 'guess' is tried first. A function of its arguments alone: no chance, the order of the
// displacements aside.
std::optional<FittedSimilarity> FitSimilarity(absl::Span<const Displacement> displacements, const Tolerance& tolerance,
                                              const Similarity& guess);

}  // namespace holdfast
