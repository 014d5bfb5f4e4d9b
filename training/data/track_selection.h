// SPDX-License-Identifier: Apache-2.0
// Which tracks of a real clip are fit to learn from or to score, and how to pick a fixed number of them.
#pragma once

#include <cstdint>
#include <vector>

#include "training/data/sample.h"

namespace holdfast {

struct TrackRules {
  float visible_margin_px = 1;     // nearer to the border than this is not visible
  float valid_outside_px = 64;     // further out than this is not valid; negative: as far inside
  int64_t good_at_start = 2;       // first frames in which a track must be visible and valid
  double good_frames_power = 0.5;  // ... and in at least frames^power of them,
  int64_t good_frames_least = 0;   // and this many
  bool off_mask_edges = true;      // tracks that start on the edge of a mask are dropped
  // Tracks with a larger per-frame change of position, of velocity or of acceleration are dropped. Shares of the larger
  // image side; 0: no bound.
  double max_velocity = 0.4;
  double max_acceleration = 0.3;
  double max_jerk = 0.1;

  static TrackRules Training() { return {}; }
  static TrackRules Evaluation() { return {1, -1, 1, 0, 8, false, 0, 0, 0}; }
};

// Clears 'visible' and 'valid' by the two distances of the rules.
void MarkOutside(const TrackRules& rules, Sample& sample);
// Tracks that keep the rules, in order. REQUIRES: MarkOutside was called.
std::vector<int64_t> GoodTracks(const TrackRules& rules, const Sample& sample);
// 'count' of 'candidates' far from each other in start and mean motion, farthest first; all if there are not more.
std::vector<int64_t> SpreadOut(const Sample& sample, const std::vector<int64_t>& candidates, int64_t count);
// 'count' of 'candidates' at even distances in their order; all if there are not more, or if count is 0.
std::vector<int64_t> EvenlyPicked(const std::vector<int64_t>& candidates, int64_t count);
// Adds points that are nowhere valid until there are 'count', so that samples can be stacked.
void PadPoints(int64_t count, Sample& sample);

}  // namespace holdfast
