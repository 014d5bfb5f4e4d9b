// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "api/types.h"
#include "training/data/sample.h"

namespace holdfast {

// What a method says about the N points of a clip of S frames, in the clip's pixels.
struct ClipEstimate {
  std::vector<float> positions;      // [S, N, 2] (x, y); NaN before a point's query
  std::vector<uint8_t> visible;      // [S, N] 0 or 1
  std::vector<float> confidence;     // [S, N] in [0, 1]; empty: the method has none
  ImageSize processing_size;         // at which the method looked at the frames
  std::optional<double> iterations;  // of a window of a point, their mean; empty: the method has none
};

// A method under evaluation: follows points through one clip at a time. One thread at a time may call it.
class ClipTracker {
 public:
  virtual ~ClipTracker() = default;
  // One line that tells this method and its settings from others.
  virtual std::string name() const = 0;
  // Point n is given where the clip says it is in frame query_frames[n]; nothing else of the clip's truth may be used.
  // REQUIRES: clip.Validate() is OK, query_frames has num_points() entries in [0, num_frames()).
  virtual absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) = 0;
};

}  // namespace holdfast
