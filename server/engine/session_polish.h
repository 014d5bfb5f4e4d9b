// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/motion/polish.h"
#include "server/engine/session_flow.h"
#include "server/engine/tracks/track_set.h"

namespace holdfast {

// The polish of a session: what windows have made final is moved to where the pictures say, a job at a time, on threads
// that have nothing better to do. The compute thread starts a job and takes its results over; in between any thread
// polishes it frame by frame, so that the frames of others are decoded between two of its own.
class SessionPolish {
 public:
  // 'flow' must outlive the object and keep the frames that TrackSet::oldest_for_polish asks for.
  explicit SessionPolish(SessionFlow& flow) : flow_(flow) {}

  // --- The compute thread.
  // True: a job has begun, and Step has to be called until it says that nothing is left. False: a job is under way, or
  // there is nothing to polish. The tracks must live until Finish.
  bool Start(TrackSet& tracks);
  // Gives 'tracks' the positions of the job that is done and adds what they report to 'runs'. False: none is done.
  bool Finish(TrackSet& tracks, std::vector<PointRun>& runs) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- Any thread, one at a time.
  // Polishes one frame of the job. False: that was the last one, and Finish has the results. A job whose work throws is
  // never done: its session ends.
  bool Step() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Job {
    std::vector<PointTrack*> tracks;      // only the compute thread looks at them
    std::vector<PolishTrack> work;        // one each
    std::deque<FlowPyramidPtr> pyramids;  // from frame 'first' on, up to the last to polish
    int64_t first = 0;                    // polished up to here
  };
  // The search in the frame after this one goes on from where the point is kept, in feature pixels, which round: that
  // frame may be of another job, or of a session that goes on with this one.
  void RoundPrevious(PolishTrack& track, int64_t frame) const;

  SessionFlow& flow_;
  std::unique_ptr<Job> job_;  // of Start, Step and Finish in turn; null: none is under way
  absl::Mutex mutex_;
  bool done_ ABSL_GUARDED_BY(mutex_) = false;  // job_ is the compute thread's again
};

}  // namespace holdfast
