// SPDX-License-Identifier: Apache-2.0
// Random numbers that are the same everywhere for the same seed: the engine is fixed by the standard, the
// distributions (which it leaves to each library) are written out here.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>

namespace holdfast {

// Spreads two numbers over 64 bits (SplitMix64's finalizer), to seed an engine per (seed, index).
inline uint64_t MixSeed(uint64_t seed, uint64_t index) {
  uint64_t z = seed + 0x9E3779B97F4A7C15ull * (index + 1);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

// Not for use by several threads at once. Draw once an expression, but for lists in braces: compilers differ in which
// of two calls they make first, and a seed's clip shall be the same everywhere.
class Rng {
 public:
  explicit Rng(uint64_t seed) : engine_(seed) {}
  Rng(uint64_t seed, uint64_t index) : Rng(MixSeed(seed, index)) {}

  uint64_t Next() { return engine_(); }
  // [0, 1)
  double Uniform() { return static_cast<double>(Next() >> 11) * 0x1.0p-53; }
  // [low, high)
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  bool Chance(double probability) { return Uniform() < probability; }
  // 0 .. count - 1. REQUIRES: count > 0; the bias for counts far below 2^64 is beyond notice.
  int64_t Below(int64_t count) { return static_cast<int64_t>(Next() % static_cast<uint64_t>(count)); }
  // low .. high, both included
  int64_t Integer(int64_t low, int64_t high) { return low + Below(high - low + 1); }
  // Mean 0, deviation 1.
  double Normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    return radius * std::cos(6.283185307179586 * Uniform());
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace holdfast
