// SPDX-License-Identifier: Apache-2.0
// What synthetic clips are like.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace holdfast {

struct SyntheticOptions {
  size_t count = size_t{1} << 32;  // size() of the data set; clips are made on demand
  uint64_t seed = 0;               // clip i is a function of (seed, i) and of these options alone
  int64_t frames = 24;
  int height = 256;  // pixels
  int width = 320;   // pixels
  int64_t points = 64;
  std::string pictures;            // directory with objects/ and backgrounds/; empty: procedural textures only
  double picture_share = 0.8;      // of the layers that use pictures, where there are any
  double motion_strength = 1.0;    // [0, 1]: scales every motion and bend; 0: nothing moves
  int64_t motion_ramp_clips = 0;   // clip i moves with strength * (start + (1 - start) * min(1, i / ramp)); 0: no ramp
  double motion_ramp_start = 0.2;  // [0, 1]
  double still_share = 0.12;       // of the clips that have no motion at all
  double plain_share = 0.12;       // of the clips with faint, blurred or repeated textures
  double alike_share = 0.34;       // of the clips whose objects look like one another or like the background
  bool photometric = true;         // colour drift, noise, blur, JPEG
  bool motion_blur = true;
  bool shadows = true;
  bool occluders = true;  // layers that come and go in front of all others

  absl::Status Validate() const;
};

}  // namespace holdfast
