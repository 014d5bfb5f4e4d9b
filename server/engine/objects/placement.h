// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "absl/types/span.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

// Where points are best placed: 'count' pixels of 'picture', or as many as there are, which are not zero in 'mask' (of
// the same size), spread evenly over it and away from its border and from the points in 'kept', on texture where there
// is any near. The same arguments give the same places.
std::vector<FlowPoint> PlacePoints(const GrayImage& picture, const GrayImage& mask, int count,
                                   absl::Span<const FlowPoint> kept = {});

}  // namespace holdfast
