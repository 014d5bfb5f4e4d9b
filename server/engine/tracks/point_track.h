// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>
#include <vector>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/deformation.h"
#include "server/engine/evidence.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/confidence.h"
#include "server/engine/tracks/geometry.h"
#include "server/engine/tracks/track_state.h"
#include "server/engine/tracks/window.h"

namespace holdfast {

// One point from its query to its end: its windows and the estimates that are still of use. Depends on nothing but its
// own seed and its own windows. Not thread-safe.
class PointTrack {
 public:
  // What 'rule' borrows must outlive the track.
  PointTrack(PointSeed seed, const WindowOptions& windows, const ConfidenceRule& rule);
  // Goes on where the track that 'state' was taken from was. REQUIRES: CheckTrackState(state, windows) is OK.
  PointTrack(TrackState state, const WindowOptions& windows, const ConfidenceRule& rule, const FrameGeometry& geometry);
  TrackState state() const;

  PointId id() const { return seed_.query.id; }
  uint64_t serial() const { return seed_.serial; }
  const PointSeed& seed() const { return seed_; }
  bool began() const { return schedule_.began(); }
  // Ends the track early: frames after 'last_frame' are not used any more, and those from 'stop' on not reported.
  // Windows that are due by 'last_frame' still run, and then a last one, as at the end of a stream: the point has an
  // estimate on every frame up to its end, which depends neither on the engine's pace nor on provisional windows.
  void End(int64_t last_frame, int64_t stop);
  bool ending() const { return ending_; }
  // Nobody can say any more that it ends even earlier: a point that is removed may be added again at the same frame,
  // which then is the new point's.
  bool over(int64_t newest) const { return ending_ && newest >= stop_; }
  TrackState::Ending ending_at() const { return {last_frame_, stop_}; }

  std::optional<WindowPlan> Due(int64_t newest, bool stream_ended) const;
  // 'carried': where the point may be on the frames after its newest estimate (after its query, where the window starts
  // from there), as far as that is known; on those that remain it starts where it was last. Borrows from this track.
  WindowRow Row(const WindowPlan& plan, absl::Span<const Position> carried) const;
  void Apply(const WindowPlan& plan, RowEstimate estimate, const FrameGeometry& geometry);
  // The estimates stand as they are: all of them become final.
  void Finalize();
  // The newest estimate, of frame estimated_before() - 1.
  int64_t estimated_before() const { return first_kept_ + static_cast<int64_t>(estimates_.size()); }
  Position newest_position() const { return estimates_.back().position; }
  float newest_confidence() const { return estimates_.back().confidence; }
  // Of the newest estimate: ConfidenceRule::Assurance, 1 of the query. The same after polish, and where the track is
  // restored.
  float newest_assurance() const;
  // Whether the point is to be looked for before the next full window if it is in doubt by then: those that stay lost
  // are looked for less often.
  bool worth_a_search() const;
  // The last frame of the next full window.
  int64_t next_window_last() const { return schedule_.next_start() + window_frames_ - 1; }

  // Final frames whose polished positions are not known: first .. first + positions.size() - 1.
  struct Unpolished {
    int64_t first = 0;
    std::vector<Position> positions;
    std::vector<uint8_t> visible;      // by the network's word, 0 or 1; hidden ones are not to be moved
    std::optional<Position> previous;  // polished, on frame first - 1; empty: hidden there
    Deformation deformation;           // of the query's surroundings, where they were found last
  };
  bool waits_for_polish() const { return polish_ && reportable_before_ < std::min(final_before_, stop_); }
  int64_t reportable_before() const { return reportable_before_; }
  Unpolished unpolished() const;
  struct Polished {
    Position position;
    Evidence::Polish outcome = Evidence::Polish::kNotTried;
  };
  // Of the frames from reportable_before() on. 'deformation': as Unpolished has it, after these.
  void Polish(absl::Span<const Polished> polished, const Deformation& deformation, const FrameGeometry& geometry);

  // What is new since the last call: frames that became final, and with 'provisional' those after them.
  std::optional<PointRun> TakeRun(bool provisional, const FrameGeometry& geometry);

  // s_k of the next full window, and the oldest frame that any window to come needs, save the last of a stream.
  int64_t next_start() const { return schedule_.next_start(); }
  int64_t oldest_frame_needed() const;
  // Frames of this track before this one have been reported as final.
  int64_t reported_before() const { return sent_before_; }
  size_t estimates_kept() const { return estimates_.size(); }

 private:
  struct Estimate {
    Position position;  // windows start from it
    Position shown;     // what is reported: polished
    Evidence evidence;
    float confidence = 1;
    bool seen = true;     // by the network's word, inside the frame
    bool visible = true;  // as reported
  };
  Estimate Restored(const EstimateState& state, int64_t frame, const FrameGeometry& geometry) const;
  const Estimate& At(int64_t frame) const { return estimates_[frame - first_kept_]; }
  Estimate Judge(const RowEstimate& row, const WindowPlan& plan, int64_t frame, const FrameGeometry& geometry) const;
  // Fills in what follows from the evidence and from where the point is shown.
  void Weigh(Estimate& estimate, const FrameGeometry& geometry) const;
  void Append(int64_t frame, PointRun& run, const FrameGeometry& geometry) const;
  void Trim();

  PointSeed seed_;
  ConfidenceRule rule_;
  int64_t window_frames_;
  bool polish_;
  WindowSchedule schedule_;
  bool ending_ = false;
  int64_t last_frame_ = std::numeric_limits<int64_t>::max();
  int64_t stop_ = std::numeric_limits<int64_t>::max();
  std::deque<Estimate> estimates_;  // of consecutive frames from first_kept_ on
  int64_t first_kept_;
  int64_t final_before_;
  int64_t reportable_before_;         // final, and polished where that is wanted
  std::optional<Position> previous_;  // reported on frame reportable_before_ - 1; empty: hidden there
  Deformation deformation_;           // of the query's surroundings, where polish found them last
  int64_t sent_before_;               // frames before this one were reported as final
  int64_t lost_windows_ = 0;          // how many full windows in a row have left the point in doubt
  CarriedTemplates carried_;
};

}  // namespace holdfast
