// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "absl/types/span.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

// A point on consecutive frames, the end of which is not to be relied on: it was hidden, or left the frame, or moved
// faster than flow can follow.
struct LostChain {
  const FlowPatch* patch = nullptr;
  std::vector<FlowPyramidPtr> pictures;  // one at least
  std::vector<FlowPoint> points;         // in each of the pictures
  bool found = false;
};

// Re-detection, as long-term trackers have it (Kalal et al., "Tracking-Learning-Detection", 2012): looks for the
// surroundings of each query far around where the point is thought to be in the last picture, which all chains end on.
// Where they are found, and nowhere else nearly as well, the point is moved there, and in the pictures before that to
// where flow leads back with round trips of at most 'max_round_trip' pixels; in the first one it stays. What comes of a
// chain depends on that chain alone.
void FindAgain(absl::Span<LostChain> chains, float max_round_trip);

}  // namespace holdfast
