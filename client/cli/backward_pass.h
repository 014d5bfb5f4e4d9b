// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "api/point_tracker.h"
#include "client/cli/frame_spool.h"
#include "program/termination.h"

namespace holdfast {

// A point that is tracked from this frame back to the first one.
struct PastQuery {
  PointQuery point;
  int64_t frame = 0;  // > 0
};

// What lies before points' queries: a session of its own over the frames from the last query's down to the first, so
// that the point is followed as if the video ran backwards. Estimates come out with the frames' own numbers.
class BackwardPass final : public TrackObserver {
 public:
  // Takes an update with estimates of frames before the points' queries only. Not OK ends the pass.
  using Deliver = std::function<absl::Status(const TrackUpdate& update)>;

  // 'config': of the session, but for its points. 'frames': from the video's first one on, as 'config' says they are
  // encoded; at least up to the last query's. 'events' hears of warnings and lost servers. None is owned.
  // REQUIRES: there is a query.
  BackwardPass(SessionConfig config, const std::vector<PastQuery>& queries, const FrameSpool& frames,
               TrackObserver& events, Deliver deliver);

  int64_t frames() const { return last_ + 1; }
  // CANCELLED where 'stop' came.
  absl::Status Run(PointTracker& tracker, StopSignal& stop);

  void OnTracks(TrackUpdate update) override;
  void OnWarning(const absl::Status& warning) override { events_.OnWarning(warning); }
  void OnReconnecting(const absl::Status& lost) override { events_.OnReconnecting(lost); }
  void OnResumed(const SessionAccepted& accepted) override;
  void OnDone(const absl::Status&, const SessionSummary&) override {}  // Finish returns the status as well

 private:
  absl::Status PushFrames(TrackStream& stream);
  absl::Status broken() const ABSL_LOCKS_EXCLUDED(mutex_);

  SessionConfig config_;
  const FrameSpool& frames_;
  TrackObserver& events_;
  const Deliver deliver_;
  int64_t last_ = 0;                                   // the last query's frame: the session's first
  absl::flat_hash_map<PointId, int64_t> queried_;      // frames of the queries
  std::map<int64_t, std::vector<PointQuery>> starts_;  // by the session's frame
  mutable absl::Mutex mutex_;
  absl::Status broken_ ABSL_GUARDED_BY(mutex_);
};

// A run of a session over the frames last, last - 1, ... 0, told of these: at most one run of final estimates and one
// of provisional ones. Only of frames before 'end'.
std::vector<PointRun> ReversedRuns(const PointRun& run, int64_t last, int64_t end);

}  // namespace holdfast
