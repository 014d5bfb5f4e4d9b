// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "api/types.h"
#include "server/engine/deformation.h"
#include "server/engine/evidence.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

struct PointSeed {
  uint64_t serial = 0;         // tells this track from any other of its session
  PointQuery query;            // the caller's pixels
  int64_t frame = 0;           // queried at
  Position position;           // the query in feature pixels
  std::vector<float> feature;  // [C] f1, kept for ever
};

// An estimate of one frame, without what follows from it.
struct EstimateState {
  Position position;  // windows start from it
  Position shown;     // what is reported: polished
  float visibility_logit = 0;
  float similarity = 1;
  float last_step = 0;
  Evidence::Polish polish = Evidence::Polish::kNotTried;
  bool seen = true;  // by the network's word, inside the frame
};

// All that a point's track is made of, as plain values: a track made of it goes on as the one it was taken from would
// have. Chaining::kPublished keeps more than this, and has no checkpoints.
struct TrackState {
  PointSeed seed;
  // The schedule of its windows, see WindowSchedule.
  int64_t next_start = 0;
  int64_t covered = 0;
  // The track is to end: after this frame, and is not reported from 'stop' on.
  struct Ending {
    int64_t last_frame = 0;
    int64_t stop = 0;
  };
  std::optional<Ending> ending;
  int64_t first_kept = 0;                // frame of estimates[0]
  std::vector<EstimateState> estimates;  // of consecutive frames; never empty
  int64_t final_before = 0;
  int64_t reportable_before = 0;
  std::optional<Position> previous;  // reported on frame reportable_before - 1; empty: hidden there
  Deformation deformation;           // of the query's surroundings, where polish found them last
  int64_t sent_before = 0;
  int64_t lost_windows = 0;  // how many full windows in a row have left the point in doubt
};

}  // namespace holdfast
