// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/similarity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

namespace holdfast {
namespace {

constexpr size_t kMostPairs = 512;    // of displacements that a similarity is made of
constexpr double kLeastApart = 1e-3;  // pixels: two places that tell of a turn
constexpr double kMostScale = 20;     // an object that seems to grow or shrink by more is not seen
constexpr size_t kLeastInliers = 3;
constexpr int kRefinements = 4;

double SquaredResidual(const Similarity& motion, const Displacement& d) {
  const double x = motion.a * d.from.x - motion.b * d.from.y + motion.tx - d.to.x;
  const double y = motion.b * d.from.x + motion.a * d.from.y + motion.ty - d.to.y;
  return x * x + y * y;
}

bool IsPlausible(const Similarity& motion) {
  const double scale = motion.scale();
  return std::isfinite(scale) && scale < kMostScale && scale > 1 / kMostScale;
}

std::optional<Similarity> OfPair(const Displacement& p, const Displacement& q) {
  const double fx = double{q.from.x} - p.from.x, fy = double{q.from.y} - p.from.y;
  const double tx = double{q.to.x} - p.to.x, ty = double{q.to.y} - p.to.y;
  const double square = fx * fx + fy * fy;
  if (square < kLeastApart * kLeastApart) return std::nullopt;
  Similarity motion;
  motion.a = (tx * fx + ty * fy) / square;
  motion.b = (ty * fx - tx * fy) / square;
  motion.tx = p.to.x - (motion.a * p.from.x - motion.b * p.from.y);
  motion.ty = p.to.y - (motion.b * p.from.x + motion.a * p.from.y);
  if (!IsPlausible(motion)) return std::nullopt;
  return motion;
}

// The least squares' similarity of the displacements that 'motion' explains.
std::optional<FittedSimilarity> Refined(absl::Span<const Displacement> displacements, const Tolerance& tolerance,
                                        const Similarity& motion) {
  const double most = tolerance.Of(motion) * tolerance.Of(motion);
  double n = 0, fx = 0, fy = 0, tx = 0, ty = 0;
  std::vector<const Displacement*> inliers;
  for (const Displacement& d : displacements) {
    if (SquaredResidual(motion, d) > most) continue;
    inliers.push_back(&d);
    ++n, fx += d.from.x, fy += d.from.y, tx += d.to.x, ty += d.to.y;
  }
  if (inliers.size() < kLeastInliers) return std::nullopt;
  fx /= n, fy /= n, tx /= n, ty /= n;
  double square = 0, dot = 0, cross = 0;
  for (const Displacement* d : inliers) {
    const double px = d->from.x - fx, py = d->from.y - fy, qx = d->to.x - tx, qy = d->to.y - ty;
    square += px * px + py * py;
    dot += px * qx + py * qy;
    cross += px * qy - py * qx;
  }
  if (square < kLeastApart * kLeastApart) return std::nullopt;
  Similarity refined{dot / square, cross / square};
  refined.tx = tx - (refined.a * fx - refined.b * fy);
  refined.ty = ty - (refined.b * fx + refined.a * fy);
  if (!IsPlausible(refined)) return std::nullopt;
  return FittedSimilarity{refined, inliers.size()};
}

// Squares of what is left over, in tolerances; beyond one it does not matter how far.
double Cost(absl::Span<const Displacement> displacements, const Tolerance& tolerance, const Similarity& motion) {
  const double most = tolerance.Of(motion) * tolerance.Of(motion);
  double cost = 0;
  for (const Displacement& d : displacements) cost += std::min(SquaredResidual(motion, d) / most, 1.0);
  return cost;
}

}  // namespace

Pixel Similarity::Map(Pixel p) const {
  return {static_cast<float>(a * p.x - b * p.y + tx), static_cast<float>(b * p.x + a * p.y + ty)};
}

Pixel Similarity::MapBack(Pixel p) const {
  const double x = p.x - tx, y = p.y - ty, square = a * a + b * b;
  return {static_cast<float>((a * x + b * y) / square), static_cast<float>((a * y - b * x) / square)};
}

double Similarity::scale() const { return std::hypot(a, b); }
double Similarity::rotation() const { return std::atan2(b, a); }

double Distance(Pixel a, Pixel b) { return std::hypot(double{a.x} - b.x, double{a.y} - b.y); }

double Tolerance::Of(const Similarity& motion) const {
  const double scale = motion.scale();
  return std::max(share * std::min(scale, std::max(before, 1.0)), least * std::min(scale / before, 1.0));
}

std::optional<FittedSimilarity> FitSimilarity(absl::Span<const Displacement> displacements, const Tolerance& tolerance,
                                              const Similarity& guess) {
  Similarity best = guess;
  double least = Cost(displacements, tolerance, guess);
  const auto consider = [&](const Displacement& p, const Displacement& q) {
    const std::optional<Similarity> motion = OfPair(p, q);
    if (!motion) return;
    const double cost = Cost(displacements, tolerance, *motion);
    if (cost >= least) return;
    best = *motion;
    least = cost;
  };
  const size_t count = displacements.size();
  if (count < kLeastInliers) return std::nullopt;
  // Every pair once or, of many displacements, an even choice in which each takes part.
  const size_t pairs = count * (count / 2);
  size_t step = (pairs + kMostPairs - 1) / kMostPairs;
  while (std::gcd(step, count) != 1) ++step;
  for (size_t pair = 0; pair < pairs; pair += step) {
    const size_t first = pair % count, apart = 1 + pair / count;
    consider(displacements[first], displacements[(first + apart) % count]);
  }
  std::optional<FittedSimilarity> fitted = FittedSimilarity{best};
  for (int i = 0; i < kRefinements && fitted; ++i) fitted = Refined(displacements, tolerance, fitted->motion);
  return fitted;
}

}  // namespace holdfast
