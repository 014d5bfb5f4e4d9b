// SPDX-License-Identifier: Apache-2.0
// Points that have left their object, and where new ones are placed for them.
#pragma once

#include <cstdint>
#include <vector>

#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/objects/object_state.h"

namespace holdfast {

// Points of an object to be placed anew, and all that says where. Pixels of the caller's frame 'frame'.
struct Reseeding {
  int64_t frame = 0;           // new points are queried there
  std::vector<PointId> lost;   // whose places are to be taken; empty: none
  std::vector<Pixel> belong;   // where these would be if they had moved with the object
  std::vector<Pixel> kept;     // where its other points are
  std::vector<Pixel> outline;  // of the object
  float spacing = 0;           // how far its points are from each other, about
};

// Of an object whose next frame has been judged, and told its motion: which points have left it while it is in sight,
// around where they belong too; at most a quarter at a time, and none whose place another one is still leaving.
// 'covered': the last frame that the windows of its points have come to.
Reseeding FindReseeding(const ObjectState& state, int64_t covered);

// At most as many places as points were lost, and none twice: near where these belong, inside the outline and the frame
// of size 'frame', on texture, away from the points that were kept. 'picture' is that frame in grey, of any size. The
// same arguments give the same places.
std::vector<Pixel> PlaceAnew(const Reseeding& reseeding, const GrayImage& picture, ImageSize frame);

}  // namespace holdfast
