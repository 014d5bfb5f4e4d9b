// SPDX-License-Identifier: Apache-2.0
#pragma once

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

// Is told of every estimate that became final, save those of the queries themselves. Called on the engine's threads,
// before the estimate is reported; one call at a time a session.
using EvidenceSink = std::function<void(PointId id, int64_t frame, const Evidence& evidence)>;

}  // namespace holdfast
