// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>

#include "api/types.h"

namespace holdfast {

// What speaks for and against one estimate of a point.
struct Evidence {
  // Whether the pictures confirmed a final estimate, see PolishFrame.
  enum class Polish : uint8_t {
    kNotTried,    // provisional, hidden by the network's word, or not asked for
    kFromQuery,   // the surroundings of the query were found there
    kFromBefore,  // the position on the frame before leads there
    kNotFound,
  };
  float visibility_logit = std::numeric_limits<float>::quiet_NaN();  // NaN: the network says nothing about visibility
  float similarity = 1;  // cosine of the template and the feature at the estimate
  float last_step = 0;   // feature pixels moved in the last iteration
  int64_t age = 0;       // frames since the query
  Polish polish = Polish::kNotTried;
};

// 'value' as near as 8 significant bits come, NaN as itself. What the network says for and against an estimate is kept
// so: that is more than it is worth, and takes half the bytes in a checkpoint, which has to say exactly what was kept.
inline float Coarse(float value) {
  if (!std::isfinite(value)) return value;
  int exponent = 0;
  const float fraction = std::frexp(value, &exponent);
  return std::ldexp(std::round(fraction * 256) / 256, exponent);
}

// Is told of every estimate that became final, save those of the queries themselves. Called on the engine's threads,
// before the estimate is reported; one call at a time a session.
using EvidenceSink = std::function<void(PointId id, int64_t frame, const Evidence& evidence)>;

}  // namespace holdfast
