// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "proto/clock.h"
#include "proto/types.h"
#include "server/engine/admission.h"
#include "server/engine/engine.h"
#include "server/engine/latency_log.h"
#include "server/engine/metrics.h"
#include "server/engine/point_queue.h"
#include "server/engine/session_inbox.h"
#include "server/engine/track_set.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// One stream inside the engine: an inbox that any thread fills, and the tracks, which belong to the compute thread. The
// handle, queued decode jobs and the scheduler share it; after OnDone it does nothing more.
class Session {
 public:
  struct Options {
    SessionAccepted accepted;
    SessionInbox::Options inbox;
    WindowOptions windows;
    bool provisional = true;
    bool carry_templates = false;
    int stride = 8;
    int64_t max_cached_frames = 0;  // above a window, so that a full cache always holds a window that is due
  };
  // 'listener', 'clock' and 'metrics' must outlive the session, the listener only until OnDone has returned.
  Session(const Options& options, SessionListener& listener, Clock& clock, EngineMetrics& metrics,
          std::unique_ptr<Admission::Ticket> ticket);

  // --- Any thread.
  const SessionAccepted& accepted() const { return options_.accepted; }
  SessionInbox& inbox() { return inbox_; }
  absl::StatusOr<Room> PushFrame(Frame frame);
  // Decodes one frame in place; on a thread of the decode pool.
  void Decode(int64_t index);
  // Until OnDone has returned.
  void AwaitDone() ABSL_LOCKS_EXCLUDED(done_mutex_);

  // --- The compute thread. All calls to the listener come from here.
  const Options& options() const { return options_; }
  bool done() const { return closed_; }
  // Frames that may be encoded now: decoded, and within what the cache may hold.
  int64_t FramesReady() const;
  std::vector<DecodedFrame> TakeFrames(int64_t count);
  void Admit(const DecodedFrame& frame, FrameFeaturesPtr features, TrackerModel& model);
  // Points added or removed at frames that are there.
  void ApplyOps(TrackerModel& model);
  std::vector<DueRow> DueRows() const { return tracks_.Due(inbox_.drained()); }
  TrackSet& tracks() { return tracks_; }
  void Deliver(std::vector<PointRun> runs);
  // Ends tracks, forgets frames, and ends the session when it is cancelled or has nothing left to do.
  void Settle();
  // Ends the session as it stands.
  void Close(const absl::Status& status);

 private:
  void Seed(const std::vector<PointQuery>& queries, int64_t frame, TrackerModel& model);
  void CountPoints(int64_t before);

  const Options options_;
  SessionListener& listener_;
  Clock& clock_;
  EngineMetrics& metrics_;
  SessionInbox inbox_;

  // Compute thread only.
  std::unique_ptr<Admission::Ticket> ticket_;
  TrackSet tracks_;
  LatencyLog latency_;
  SessionSummary summary_;
  bool closed_ = false;

  absl::Mutex done_mutex_;
  absl::CondVar done_changed_;
  bool done_ ABSL_GUARDED_BY(done_mutex_) = false;
};

}  // namespace holdfast
