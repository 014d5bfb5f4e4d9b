// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/admission.h"
#include "server/engine/checkpoint_sealer.h"
#include "server/engine/engine.h"
#include "server/engine/input/point_queue.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/metrics.h"
#include "server/engine/session_flow.h"
#include "server/engine/session_polish.h"
#include "server/engine/session_report.h"
#include "server/engine/session_reseeding.h"
#include "server/engine/session_state.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/track_set.h"

namespace holdfast {

// One stream inside the engine: an inbox that any thread fills, the tracks, which belong to the compute thread, and
// optical flow, which threads of the decode pool compute: they carry points from frame to frame as frames are decoded,
// and polish what has become final. Windows wait for the flow they start from, the compute thread does not. The handle,
// queued jobs and the scheduler share the session; after OnSessionDone it does nothing more.
class Session : public std::enable_shared_from_this<Session> {
 public:
  struct Options {
    SessionAccepted accepted;
    SessionInbox::Options inbox;
    WindowOptions windows;
    bool provisional = true;
    bool carry_templates = false;
    ConfidenceRule confidence;  // what it borrows outlives the session
    int stride = 8;
    int64_t max_cached_frames = 0;             // above a window, so that a full cache always holds a window that is due
    const CheckpointSealer* sealer = nullptr;  // null: no checkpoints; outlives the session
    std::string weights_sha256;
    double least_step = 0;  // of EngineOptions, for checkpoints
  };
  struct Threads {
    std::function<void(std::function<void()>)> submit;  // runs a job on a thread of the decode pool
    std::function<void()> notify;                       // there may be something new for the compute thread
  };
  // The most that a session's pictures and patches for optical flow take; 0 when it uses none.
  static int64_t FlowBytes(const Options& options);
  // The most frames that a checkpoint lies behind the newest tracked one.
  static int64_t ReplayFrames(const Options& options) { return options.max_cached_frames + options.windows.hop; }

  // 'listener', 'clock' and 'metrics' must outlive the session, the listener only until OnSessionDone has returned. A
  // session without a ticket has reserved nothing.
  Session(const Options& options, SessionListener& listener, Clock& clock, EngineMetrics& metrics, Threads threads,
          std::unique_ptr<Admission::Ticket> ticket);
  // Before anything else: goes on where the session was that 'state' was taken from. REQUIRES: CheckState is OK, and
  // the inbox's options say the same.
  void Resume(SessionState state);

  // --- Any thread.
  const SessionAccepted& accepted() const { return options_.accepted; }
  SessionInbox& inbox() { return inbox_; }
  // Decodes the frame on the decode pool.
  absl::StatusOr<Room> PushFrame(Frame frame);
  // As those of the inbox.
  absl::Status AddPoints(const std::vector<PointQuery>& points);
  absl::Status RemovePoints(const std::vector<PointId>& ids);
  // Until OnSessionDone has returned.
  void AwaitDone() ABSL_LOCKS_EXCLUDED(done_mutex_);

  // --- The compute thread.
  const Options& options() const { return options_; }
  bool done() const { return closed_; }
  // Frames that may be encoded now: decoded, and within what the cache may hold.
  int64_t FramesReady() const;
  std::vector<DecodedFrame> TakeFrames(int64_t count);
  void Admit(const DecodedFrame& frame, FrameFeaturesPtr features, TrackerModel& model);
  // Points added or removed at frames that are there.
  void ApplyOps(TrackerModel& model);
  // Rows whose starts are known.
  std::vector<DueRow> DueRows();
  // Fills the starts in. REQUIRES: 'rows' came from DueRows.
  void AddStarts(std::vector<DueRow>& rows) const;
  const TrackSet& tracks() const { return tracks_; }
  // Work of the model for this session, among others. Before what came of it is taken.
  void TellEncoded(const std::vector<DecodedFrame>& frames, SteadyTime begin, SteadyTime end);
  void TellRefined(absl::Span<const DueRow> rows, SteadyTime begin, SteadyTime end);
  // The rows' results, in order, are at 'estimates'.
  void Apply(absl::Span<const DueRow> rows, RowEstimate* estimates);
  int64_t CachedBytes() const;
  // Takes over what was polished, ends tracks, places points of objects anew, forgets frames, and ends the session when
  // it is cancelled or has nothing left to do. True: there may be room for frames that nobody will report, or windows
  // that have waited.
  bool FinishTurn(TrackerModel& model);
  // All that it takes to go on elsewhere, as before what was said about points at the newest frame, which comes again.
  // REQUIRES: that frame is not the first, whose points came with the configuration.
  SessionState State();
  // Ends the session as it stands.
  void Close(const absl::Status& status);

 private:
  // On a thread of the decode pool.
  void Decode(int64_t index);
  // Those that are queried at the frame, which is 'gray'.
  absl::Status PlaceObjects(int64_t index, absl::Span<const WaitingObject> objects, const GrayImage& gray);
  void AdvanceFlow();
  // With the right to flow_->Step, which it keeps where it submits itself anew.
  void StepFlow();
  // Polishes one frame and comes again until all are done.
  void PolishNextFrame();
  // What the work throws ends the session.
  void RunFlow(absl::FunctionRef<void()> work) ABSL_LOCKS_EXCLUDED(flow_failure_mutex_);
  // AdvanceFlow on the decode pool, unless a job waits there that will do.
  void SubmitFlow();
  // Seals 'state' and sends it, or says that there is no checkpoint any more. 'order': of checkpoints_, which counts
  // them when their states are taken.
  bool SendCheckpoint(int64_t order, const SessionState& state);
  // Once the first frame has come.
  ImageSize flow_size() const { return FlowSize(inbox_.frame_size(), options_.accepted.processing_size); }

  // Either: moves the operations up to this frame from the inbox to where the tracks take them from, and seeds and ends
  // chains as they say. 'applied': the tracks take them at once.
  void FetchOps(int64_t newest, bool applied) ABSL_LOCKS_EXCLUDED(ops_mutex_);
  std::vector<PointOp> TakeOps(int64_t newest) ABSL_LOCKS_EXCLUDED(ops_mutex_);
  bool AnyOps() ABSL_LOCKS_EXCLUDED(ops_mutex_);

  FrameGeometry geometry() const {
    return FrameGeometry(inbox_.frame_size(), options_.accepted.processing_size, options_.stride);
  }
  void SetFlowGeometry();
  void RestoreFlow(const PointTrack& track, std::optional<FlowPatch> patch);
  static SessionFlow::Base BaseOf(const PointTrack& track, bool early);
  // As before what was said about the track's point at 'taken_frame'.
  SessionState::Track SavedTrack(const PointTrack& track, int64_t taken_frame) const;

  // On the compute thread.
  // 'ended': tracks whose last runs these are.
  void Deliver(std::vector<PointRun> runs, absl::Span<const TrackSet::Dropped> ended = {});
  void StartChains(absl::Span<const DueRow> rows);
  void StartPolish();
  bool FinishPolish();
  // A resumed session has not seen all the frames again that its tracks have been through.
  bool CatchingUp() const { return tracks_.cache().newest() < taken_frame_; }
  // Unless the stream has ended with a mistake: the last checkpoint is taken before the windows that this makes due.
  void StartCheckpoint(const absl::Status& end_status);
  // Whether there are tokens for its state, as far as is known.
  bool CanSeal() const { return options_.sealer != nullptr && !outgrown_; }
  bool OwesLastCheckpoint(const SessionInbox::Standing& stream) const;
  void Suspend(const absl::Status& status);
  absl::Status EndedTooEarly(const absl::Status& status) const;
  // Ends the session once what there is has become final, and polished. False: it is not, or points are still to come.
  // REQUIRES: the stream has ended with 'status', and no window is due.
  bool FinishStream(const absl::Status& status);
  void EndTracks();
  void Evict();
  absl::Status FlowFailure() ABSL_LOCKS_EXCLUDED(flow_failure_mutex_);
  void Remove(const PointOp& removal);
  // Places points anew where objects have lost some by their final word. True: there were such objects.
  bool ReseedObjects(TrackerModel& model);
  void CountPoints(int64_t before);

  const Options options_;
  Clock& clock_;
  EngineMetrics& metrics_;
  const Threads threads_;
  SessionInbox inbox_;
  const std::unique_ptr<SessionFlow> flow_;  // null: nothing needs it
  std::atomic<bool> flow_job_waits_{false};
  const std::unique_ptr<SessionPolish> polish_;  // null: not asked for
  absl::Mutex ops_mutex_;                        // held while operations are moved, so that they keep their order
  std::deque<PointOp> ops_ ABSL_GUARDED_BY(ops_mutex_);  // known to the flow, not to the tracks yet
  SessionReport report_;

  std::atomic<bool> sealing_{false};   // a checkpoint is being made
  std::atomic<bool> outgrown_{false};  // the state does not fit into a token any more

  absl::Mutex flow_failure_mutex_;
  absl::Status flow_failure_ ABSL_GUARDED_BY(flow_failure_mutex_);

  // Compute thread only.
  std::unique_ptr<Admission::Ticket> ticket_;
  TrackSet tracks_;
  SessionReseeding reseeding_;
  SessionSummary summary_;
  struct {
    int64_t frame = -1;
    int64_t count = 0;
  } newest_seeds_;                     // of the frame at which points were added last
  int64_t taken_frame_ = -1;           // of the session that this one goes on with
  int64_t checkpoint_frame_ = -1;      // the newest frame when the last checkpoint was made
  int64_t checkpoints_ = 0;            // so many states have been taken for one
  bool told_last_checkpoint_ = false;  // ...before a mistake
  bool suspended_ = false;
  bool closed_ = false;

  absl::Mutex done_mutex_;
  absl::CondVar done_changed_;
  bool done_ ABSL_GUARDED_BY(done_mutex_) = false;
};

}  // namespace holdfast
