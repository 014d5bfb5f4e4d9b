// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <vector>

#include "api/limits.h"
#include "api/types.h"

namespace holdfast {

// Turn, scale and shift of the plane: (x, y) becomes (a x - b y + tx, b x + a y + ty).
struct Similarity {
  double a = 1;
  double b = 0;
  double tx = 0;
  double ty = 0;

  Pixel Map(Pixel p) const;
  Pixel MapBack(Pixel p) const;
  double scale() const;
  double rotation() const;  // radians, from x towards y
};

// An object as it was queried. Pixels of the caller's frame.
struct ObjectShape {
  Pixel centre;                // of gravity
  float size = 0;              // the side of a square of its area
  std::vector<Pixel> outline;  // convex, at most kMaxOutlineCorners corners; one or two where it is a dot or a line
};

// One of an object's points, and what is known of it on the frames that the object has not come to.
struct ObjectMember {
  static constexpr int64_t kNever = std::numeric_limits<int64_t>::max();

  PointId id = 0;
  Pixel home;            // where it belongs, in pixels of the frame that the object was queried at
  int64_t queried = 0;   // that frame; of a point that was placed anew, the frame before the first one it takes part in
  int64_t end = kNever;  // it was removed, or another took its place: frames from here on are without it

  struct Sample {
    Pixel at;
    bool visible = false;
  };
  bool closed = false;         // its track has ended, and told all
  std::deque<Sample> samples;  // from the object's next frame on
  int64_t final_before = 0;    // samples of frames before this one are final
};

// An object's points, and those whose place another one has taken and that have not ended yet.
constexpr int kMaxObjectMembers = 2 * kMaxObjectPoints;

// What an object has come to by a frame.
struct ObjectJudgement {
  Similarity motion;  // since the query
  struct Standing {
    bool left = false;
    int contrary = 0;  // frames in a row, up to this one, that speak against 'left'
  };
  std::vector<Standing> standings;  // one a member
};

// All that an object is made of, as plain values.
struct ObjectState {
  ObjectId id = 0;
  int64_t query_frame = 0;
  ObjectShape shape;
  bool reseeds = false;  // points that have left are placed anew
  std::vector<ObjectMember> members;
  int64_t next = 0;           // the first frame that is not final
  ObjectJudgement judgement;  // by the frame before it
};

}  // namespace holdfast
