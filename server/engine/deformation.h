// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace holdfast {

// How the surroundings of a point have turned, grown and sheared since its query: what lies at an offset (x, y) from
// the query lies at (xx x + xy y, yx x + yy y) from the point.
struct Deformation {
  float xx = 1;
  float xy = 0;
  float yx = 0;
  float yy = 1;

  friend bool operator==(const Deformation& a, const Deformation& b) {
    return a.xx == b.xx && a.xy == b.xy && a.yx == b.yx && a.yy == b.yy;
  }
};

// Whether pictures of one surface are likely to differ so: neither mirrored nor stretched to several times the size one
// way. False for what is not finite.
inline bool Plausible(const Deformation& shape) {
  constexpr float kMostScale = 3;    // of any direction, and its inverse
  constexpr float kMostStretch = 3;  // of one direction against another
  const float determinant = shape.xx * shape.yy - shape.xy * shape.yx;
  const float squares = shape.xx * shape.xx + shape.xy * shape.xy + shape.yx * shape.yx + shape.yy * shape.yy;
  // The squares of the singular values are the roots of t^2 - squares t + determinant^2.
  const float root = std::sqrt(std::fmax(squares * squares / 4 - determinant * determinant, 0.0f));
  const float largest = squares / 2 + root, smallest = squares / 2 - root;
  return determinant > 0 && largest <= kMostScale * kMostScale && smallest * kMostScale * kMostScale >= 1 &&
         largest <= kMostStretch * kMostStretch * smallest;
}

}  // namespace holdfast
