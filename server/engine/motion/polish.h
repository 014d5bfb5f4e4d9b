// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/types/span.h"
#include "server/engine/deformation.h"
#include "server/engine/evidence.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

// Consecutive final estimates of one point, in pixels of the pyramids.
struct PolishTrack {
  std::shared_ptr<const FlowPatch> patch;  // around the query; null: not known
  std::optional<FlowPoint> previous;       // polished, on the frame polished last; empty: hidden there
  Deformation deformation;                 // of the patch, where it was found last
  int64_t first = 0;                       // frame of positions[0]
  std::vector<FlowPoint> positions;
  std::vector<uint8_t> visible;            // 0 or 1
  std::vector<Evidence::Polish> outcomes;  // of the positions polished so far
};

// Moves the visible positions of one frame to where its picture says: to where the surroundings of the query are found,
// however they have turned and grown, which does not drift; else to where the position on the frame before leads, which
// bridges changes of appearance; else they stay. Tracks without a position on the frame are left as they are. A track's
// frames come one after the other.
void PolishFrame(absl::Span<PolishTrack> tracks, int64_t frame, const FlowPyramid& before, const FlowPyramid& now);

}  // namespace holdfast
