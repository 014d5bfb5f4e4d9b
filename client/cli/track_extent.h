// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace holdfast {

// How much of its input a run has tracked. Only frames that are tracked count, from the first of them on.
struct TrackExtent {
  int64_t frames = 0;           // there are estimates up to here
  int64_t final_frames = 0;     // estimates of the first so many frames are final, those behind them may be provisional
  int64_t expected_frames = 0;  // as the input announced, or as were sent where these are more
  bool complete = false;        // the run went to its end: every estimate is there and final
  bool input_goes_on = false;   // the input is known to have frames behind the last one with estimates
};

// "frames 0..71 of 120 (0..63 are final), 72..119 are missing". 'number': of a frame that is tracked, in the input;
// where these are not simply 0, 1, 2..., "frames 10..52, 22 of 60 (10..40 are final), 54..128 are missing". REQUIRES:
// extent.frames > 0.
std::string Describe(const TrackExtent& extent, const std::function<int64_t(int64_t)>& number);

}  // namespace holdfast
