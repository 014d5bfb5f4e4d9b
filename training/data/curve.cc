// SPDX-License-Identifier: Apache-2.0
#include "training/data/curve.h"

#include <algorithm>
#include <cmath>

namespace holdfast {

Curve Curve::Random(Rng& rng, int knots, double amplitude, double duration) {
  std::vector<double> values(static_cast<size_t>(knots));
  for (double& value : values) value = rng.Uniform(-amplitude, amplitude);
  return Curve(std::move(values), duration);
}

Curve Curve::Wander(Rng& rng, double max_amplitude, double duration) {
  constexpr double kUsualDuration = 24;  // frames; longer clips turn more often, not more slowly
  const int turns = static_cast<int>(rng.Integer(1, 4));
  const double amplitude = rng.Uniform(0.2, 1) * max_amplitude * 2 / (turns + 1);
  return Random(rng, 1 + turns * static_cast<int>(std::ceil(duration / kUsualDuration)), amplitude, duration);
}

Curve Curve::Swing(double middle, double amplitude, double period, double phase, double duration) {
  constexpr double kTurn = 6.283185307179586;  // radians
  std::vector<double> values(static_cast<size_t>(std::ceil(duration)) + 1);
  const double step = duration / static_cast<double>(values.size() - 1);
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = middle + amplitude * std::sin(kTurn * step * static_cast<double>(i) / period + phase);
  }
  return Curve(std::move(values), duration);
}

double Curve::Knot(int index) const {
  const int last = static_cast<int>(knots_.size()) - 1;
  if (index < 0) return 2 * knots_.front() - knots_[1];
  if (index > last) return 2 * knots_.back() - knots_[static_cast<size_t>(last - 1)];
  return knots_[static_cast<size_t>(index)];
}

double Curve::At(double time) const {
  if (knots_.empty()) return 0;
  if (knots_.size() == 1 || duration_ <= 0) return knots_[0];
  const int segments = static_cast<int>(knots_.size()) - 1;
  const double place = time / duration_ * segments;
  const double inside = std::clamp(place, 0.0, static_cast<double>(segments));
  const int i = std::min(static_cast<int>(inside), segments - 1);
  const double u = inside - i;
  const double p0 = Knot(i - 1), p1 = Knot(i), p2 = Knot(i + 1), p3 = Knot(i + 2);
  const double a = -p0 + 3 * p1 - 3 * p2 + p3, b = 2 * p0 - 5 * p1 + 4 * p2 - p3, c = p2 - p0;
  const double value = 0.5 * (((a * u + b) * u + c) * u) + p1;
  const double slope = 0.5 * ((3 * a * u + 2 * b) * u + c);
  return value + slope * (place - inside);
}

}  // namespace holdfast
