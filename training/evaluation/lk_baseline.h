// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "training/evaluation/clip_tracker.h"

namespace holdfast {

struct LucasKanadeOptions {
  ImageSize processing_size;       // frames are resized to it; empty: as they are
  int window = 21;                 // side of the patch compared, pixels
  int levels = 3;                  // of the pyramid beyond the image itself
  double max_round_trip_px = 1.5;  // forward and backward again ends farther off: the point is hidden

  absl::Status Validate() const;
};

// The baseline everybody has: OpenCV's pyramidal Lucas-Kanade from each frame to the next. A point that gets lost or
// leaves the frame stays where it was last seen and is hidden.
absl::StatusOr<std::unique_ptr<ClipTracker>> CreateLucasKanade(const LucasKanadeOptions& options);

}  // namespace holdfast
