// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace holdfast {

// How much of its input a run has tracked. Frames count from the first one of the input.
struct TrackExtent {
  int64_t frames = 0;           // there are estimates up to here
  int64_t final_frames = 0;     // estimates of the first so many frames are final, those behind them may be provisional
  int64_t expected_frames = 0;  // as the input announced, or as were sent where these are more
  bool complete = false;        // the run went to its end: every estimate is there and final
};

// "frames 0..71 of 120 (0..63 are final), 72..119 are missing".
// REQUIRES: extent.frames > 0.
std::string Describe(const TrackExtent& extent);

}  // namespace holdfast
