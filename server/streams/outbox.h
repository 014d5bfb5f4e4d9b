// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <list>
#include <map>

#include "absl/container/flat_hash_map.h"
#include "absl/time/time.h"
#include "api/types.h"

namespace holdfast {

// Results of one session that wait for its reader, coalesced per point: newer estimates replace older ones of the same
// frames, final ones are appended. What it holds grows with the number of frames whose results wait, not with the
// number of updates. Sending what Take returns has the same effect as sending every update. Not thread-safe.
class Outbox {
 public:
  void Add(TrackUpdate update);
  bool empty() const { return runs_.empty() && !watermark_changed_; }
  int64_t bytes() const { return bytes_; }  // about what the results take in messages
  // The oldest results, about 'max_bytes' of them but at least one sample. The new watermark comes with the last of
  // them. REQUIRES: not empty.
  TrackUpdate Take(int64_t max_bytes);
  // Remembers the results that wait now, and whether any of them still do; what comes later, or is merged into them,
  // keeps them no longer.
  void Mark() { marked_ = runs_.size(); }
  bool marked_waits() const { return marked_ > 0; }

 private:
  void AddRun(PointRun run);
  PointRun TakeFront();
  PointRun SplitFront(int64_t frames);
  void AddCaptureTimes(TrackUpdate& update);
  void DropCaptureTimes();

  std::list<PointRun> runs_;                                            // in the order they have to be sent
  absl::flat_hash_map<PointId, std::list<PointRun>::iterator> newest_;  // of each point in runs_
  size_t marked_ = 0;                                                   // so many of the first runs_
  int64_t bytes_ = 0;
  int64_t frames_received_ = 0;
  int64_t frames_processed_ = 0;
  int64_t sent_received_ = 0;
  int64_t sent_processed_ = 0;
  std::map<int64_t, absl::Time> capture_times_;  // of frames whose results wait
  bool watermark_changed_ = false;
};

}  // namespace holdfast
