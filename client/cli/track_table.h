// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "api/types.h"
#include "client/cli/point_file.h"

namespace holdfast {

struct TrackSample {
  enum class State : uint8_t { kAbsent, kProvisional, kFinal };
  float x = 0;  // pixels
  float y = 0;  // pixels
  float confidence = 0;
  bool visible = false;
  State state = State::kAbsent;

  bool is_absent() const { return state == State::kAbsent; }
  bool is_final() const { return state == State::kFinal; }
};

// One point's life: samples[i] belongs to frame start.frame + i.
struct TableTrack {
  StartPoint start;
  std::vector<TrackSample> samples;
  int64_t final_frames = 0;     // the first so many samples are final
  int64_t answered_frames = 0;  // the first so many samples are there
};

// Joins the runs of a session into one track per point. A provisional estimate never replaces a final one. Not
// thread-safe.
class TrackTable {
 public:
  explicit TrackTable(std::vector<StartPoint> points);

  // INTERNAL when the update speaks of points or frames that the session does not have.
  absl::Status Apply(const TrackUpdate& update);

  const std::vector<TableTrack>& tracks() const { return tracks_; }
  int64_t frames() const { return frames_; }  // frames the tracker has accepted so far
  // No estimate of frames 0 .. final_frames() - 1 will change or be added any more.
  int64_t final_frames() const;
  // Frames up to the last one of which there is an estimate, final or provisional; 0: there is none.
  int64_t estimated_frames() const;
  // Every point that lives has an estimate on frames 0 .. answered_frames() - 1.
  int64_t answered_frames() const;
  // Null where the point has no estimate.
  static const TrackSample* Estimate(const TableTrack& track, int64_t frame);

 private:
  absl::Status ApplyRun(const PointRun& run);

  std::vector<TableTrack> tracks_;
  absl::flat_hash_map<PointId, size_t> index_;
  int64_t frames_ = 0;
};

}  // namespace holdfast
