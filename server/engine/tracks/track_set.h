// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/confidence.h"
#include "server/engine/tracks/feature_cache.h"
#include "server/engine/tracks/geometry.h"
#include "server/engine/tracks/point_track.h"
#include "server/engine/tracks/window.h"

namespace holdfast {

// A row that is due: one point in one window.
struct DueRow {
  PointTrack* track = nullptr;
  WindowPlan plan;
  std::vector<Position> carried;  // as PointTrack::Row takes it
};

// The points of one session and the features they need, and nothing else: no threads, no queue, no network. Memory is
// bounded by the points and the window, whatever the length of the video. Not thread-safe.
class TrackSet {
 public:
  // What 'rule' borrows must outlive the set.
  TrackSet(const WindowOptions& windows, bool provisional, const ConfidenceRule& rule = {})
      : windows_(windows), provisional_(provisional), rule_(rule) {}

  // Before the first seed.
  void SetGeometry(const FrameGeometry& geometry) { geometry_ = geometry; }
  const FrameGeometry& geometry() const { return geometry_; }

  // Goes on at 'frame', the first to be added. REQUIRES: nothing was added yet; the geometry is set before Restore,
  // which takes the states of another set's tracks in their order.
  void StartAt(int64_t frame) { cache_.StartAt(frame); }
  const PointTrack& Restore(TrackState state);
  const std::vector<std::unique_ptr<PointTrack>>& all() const { return tracks_; }

  void AddFrame(FrameFeaturesPtr features) { cache_.Push(std::move(features)); }
  // A track of this id ends before the seed's frame, one that was removed at that very frame too. REQUIRES: the seed's
  // frame is in the cache.
  void Seed(PointSeed seed);
  // The id's track ends after 'frame'. Unknown ids are ignored.
  void Remove(PointId id, int64_t frame);
  // The track of this id that was queried at 'query_frame' ends with what its windows have made of it, reported before
  // frame 'stop', whatever end it was to have. Whether it was to have none; unknown tracks are ignored.
  bool Stop(PointId id, int64_t query_frame, int64_t stop);

  // Rows to run, oldest window first; at most one a point. 'ended': no frame will follow.
  std::vector<DueRow> Due(bool ended) const;
  bool AnyDue(bool ended) const;
  // Input of rows that share a plan. Borrows from their tracks.
  WindowGroup Group(absl::Span<const DueRow> rows) const;
  // Takes a row's result; the run to report, if there is one. A track that waits to be polished reports afterwards.
  std::optional<PointRun> Apply(const DueRow& row, RowEstimate estimate);

  // Tracks that wait to be polished.
  std::vector<PointTrack*> Unpolished();
  // REQUIRES: 'track' was taken, and 'polished' are all frames it had unpolished then.
  std::optional<PointRun> Polish(PointTrack& track, absl::Span<const PointTrack::Polished> polished,
                                 const Deformation& deformation);
  bool AnyUnpolished() const;
  // No frame before this one is of use for polishing.
  int64_t oldest_for_polish() const;

  // Drops tracks that have ended and whose windows have run; their last runs.
  std::vector<PointRun> TakeEnded();
  // All estimates become final as they stand. REQUIRES: !AnyDue(true).
  void FinalizeAll();
  // As FinalizeAll; the last runs. REQUIRES: !AnyDue(true), and nothing waits to be polished once all is final.
  std::vector<PointRun> FinishAll();
  // Drops everything as it stands; the number of tracks there were.
  int64_t Clear();
  struct Dropped {
    uint64_t serial = 0;
    PointId id = 0;
    int64_t frame = 0;  // it was queried at
  };
  // The tracks that ended since the last call.
  std::vector<Dropped> TakeDropped() { return std::exchange(dropped_, {}); }
  // Forgets the frames that no window to come needs, but for those from 'keep' on.
  void Evict(int64_t keep = std::numeric_limits<int64_t>::max());

  const FeatureCache& cache() const { return cache_; }
  int64_t tracks() const { return static_cast<int64_t>(tracks_.size()); }
  // Frames before this one have been reported as final for every point.
  int64_t reported_before() const;

 private:
  // The newest track of the id; an end that it has already holds where it is earlier.
  void EndTrack(PointId id, int64_t last_frame, int64_t stop);
  // Calls 'visit' for each row that is due until it returns false.
  template <typename Visit>
  void VisitDue(bool ended, Visit visit) const;

  const WindowOptions windows_;
  const bool provisional_;
  const ConfidenceRule rule_;
  FrameGeometry geometry_;
  FeatureCache cache_;
  std::vector<std::unique_ptr<PointTrack>> tracks_;   // in the order they were seeded
  absl::flat_hash_map<PointId, PointTrack*> newest_;  // of each id the track that was seeded last
  std::vector<Dropped> dropped_;
};

}  // namespace holdfast
