// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/input/point_queue.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/objects/object_group.h"
#include "server/engine/session_flow.h"
#include "server/engine/session_objects.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/track_set.h"

namespace holdfast {

// Begins the tracks of queries at one frame. REQUIRES: the frame is there.
void SeedTracks(absl::Span<const PointOp> seeds, TrackerModel& model, TrackSet& tracks);

// The points of a session that are placed anew for those that have left their object: asks pictures where, and tells
// tracks and flow. For the compute thread.
class SessionReseeding {
 public:
  // The arguments must outlive the object. 'flow' null: nothing needs it, and no pictures are kept.
  SessionReseeding(ImageSize processing, SessionInbox& inbox, TrackSet& tracks, SessionFlow* flow)
      : processing_(processing), inbox_(inbox), tracks_(tracks), flow_(flow) {}

  // Places points for every object that has lost some by its final word. How many; none: there was no such object.
  std::optional<int64_t> Run(SessionObjects& objects, TrackerModel& model);

 private:
  int64_t Reseed(ObjectGroup& group, TrackerModel& model);
  // The frame in grey; plain grey where nothing keeps pictures.
  GrayImage PictureOf(int64_t frame) const;

  const ImageSize processing_;
  SessionInbox& inbox_;
  TrackSet& tracks_;
  SessionFlow* const flow_;
};

}  // namespace holdfast
