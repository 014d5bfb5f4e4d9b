// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>

#include "absl/time/time.h"
#include "api/types.h"
#include "server/streams/run_queue.h"

namespace holdfast {

// Results of one session that wait for its reader, coalesced per point and object: newer estimates replace older ones
// of the same frames, final ones are appended. What it holds grows with the number of frames whose results wait, not
// with the number of updates. Sending what Take returns has the same effect as sending every update. Not thread-safe.
class Outbox {
 public:
  void Add(TrackUpdate update);
  bool empty() const { return points_.empty() && objects_.empty() && !watermark_changed_; }
  int64_t bytes() const { return points_.bytes() + objects_.bytes(); }  // about what the results take in messages
  // The oldest results, about 'max_bytes' of them but at least one sample. The new watermark comes with the last of
  // them. REQUIRES: not empty.
  TrackUpdate Take(int64_t max_bytes);
  // Remembers the results that wait now, and whether any of them still do; what comes later, or is merged into them,
  // keeps them no longer.
  void Mark() {
    points_.Mark();
    objects_.Mark();
  }
  bool marked_waits() const { return points_.marked_waits() || objects_.marked_waits(); }

 private:
  void AddCaptureTimes(TrackUpdate& update);
  void DropCaptureTimes();

  RunQueue<PointRun> points_;
  RunQueue<ObjectRun> objects_;
  int64_t frames_received_ = 0;
  int64_t frames_processed_ = 0;
  int64_t sent_received_ = 0;
  int64_t sent_processed_ = 0;
  std::map<int64_t, absl::Time> capture_times_;  // of frames whose results wait
  bool watermark_changed_ = false;
};

}  // namespace holdfast
