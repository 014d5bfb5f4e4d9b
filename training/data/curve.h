// SPDX-License-Identifier: Apache-2.0
// Smooth random functions of time: what every parameter of a synthetic motion follows.
#pragma once

#include <vector>

#include "training/data/rng.h"

namespace holdfast {

// A Catmull-Rom spline through knots spread evenly over [0, duration]; beyond, it goes on with its slope at the end.
// No knots: 0. One: a constant. Two: a line.
class Curve {
 public:
  Curve() = default;
  Curve(std::vector<double> knots, double duration) : knots_(std::move(knots)), duration_(duration) {}

  // 'knots' values from [-amplitude, amplitude].
  static Curve Random(Rng& rng, int knots, double amplitude, double duration);
  // As Random with a few turns; an amplitude of up to the given one, smaller the more it turns.
  static Curve Wander(Rng& rng, double max_amplitude, double duration);

  // Swings about 'middle' as a sine does, with a knot every frame. The period is in frames, the phase in radians.
  static Curve Swing(double middle, double amplitude, double period, double phase, double duration);

  double At(double time) const;

 private:
  double Knot(int index) const;  // mirrored about the end knots

  std::vector<double> knots_;
  double duration_ = 1;
};

}  // namespace holdfast
