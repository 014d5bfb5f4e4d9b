// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/capture_times.h"
#include "server/engine/engine.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/latency_log.h"
#include "server/engine/metrics.h"
#include "server/engine/session_flow.h"
#include "server/engine/session_objects.h"
#include "server/engine/session_state.h"
#include "server/engine/tracks/track_set.h"

namespace holdfast {

// What a session tells its listener: one call at a time, whichever thread has something to say, and none after the end.
// Here is known what goes out with estimates: what they mean for objects, when frames were captured, how long it took.
// Thread-safe.
class SessionReport {
 public:
  // All but 'options' must outlive the object, the listener only until Done has returned. 'provisional' and 'windows'
  // as SessionObjects has them.
  SessionReport(bool provisional, const ObjectWindows& windows, SessionListener& listener, Clock& clock,
                EngineMetrics& metrics, const SessionInbox& inbox);
  // Before anything else: goes on where the session was that 'state' was taken from, of which the objects are taken.
  void Resume(SessionState& state) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- What becomes of frames.
  // The next one has come.
  void Arrived(SteadyTime when, std::optional<absl::Time> capture_time);
  // So many have been encoded.
  void Processed(int64_t frames) { processed_ = frames; }
  // Those before 'reported' are final for every point; no window needs those before 'oldest' any more.
  void Final(int64_t reported, int64_t oldest);

  // --- What the listener is told.
  void RoomForFrame() ABSL_LOCKS_EXCLUDED(mutex_);
  // To a listener that wants to know.
  void Work(const StageWork& work) ABSL_LOCKS_EXCLUDED(mutex_);
  // 'ended': tracks whose last runs these are. 'newest': the newest frame there is.
  void Tracks(std::vector<PointRun> runs, absl::Span<const TrackSet::Dropped> ended, int64_t newest)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Instant estimates that the flow has, up to frame 'newest'. REQUIRES: as SessionFlow::TakeLive.
  void Live(SessionFlow& flow, int64_t newest) ABSL_LOCKS_EXCLUDED(mutex_);
  // How far the session is, where nothing has said so since.
  void Progress() ABSL_LOCKS_EXCLUDED(mutex_);
  // A checkpoint, an empty one where there will be no more, or none this time, and why. Nothing where a newer one, of a
  // greater 'order', has been told.
  void CheckpointTaken(int64_t order, const absl::Status& sealed, std::optional<Checkpoint> checkpoint)
      ABSL_LOCKS_EXCLUDED(mutex_);
  void Done(const absl::Status& status, const SessionSummary& summary) ABSL_LOCKS_EXCLUDED(mutex_);

  // Runs 'work', a function of SessionObjects&, while nothing is told, and returns what it does.
  template <typename Work>
  auto WithObjects(Work&& work) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return std::forward<Work>(work)(objects_);
  }

 private:
  void Emit(std::vector<PointRun> runs) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Send(TrackUpdate update) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  SessionListener& listener_;
  const bool tells_work_;
  Clock& clock_;
  EngineMetrics& metrics_;
  const SessionInbox& inbox_;
  LatencyLog latency_;
  CaptureTimes capture_times_;
  std::atomic<int64_t> processed_{0};

  absl::Mutex mutex_;  // held in every call of the listener
  SessionObjects objects_ ABSL_GUARDED_BY(mutex_);
  bool done_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t told_processed_ ABSL_GUARDED_BY(mutex_) = 0;  // frames_processed of the newest update
  // Of the newest checkpoint that was told: the last one of a session may overtake one that is being made.
  int64_t told_checkpoint_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace holdfast
