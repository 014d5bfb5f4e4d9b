// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/objects/object_state.h"
#include "server/engine/tracks/track_state.h"

namespace holdfast {

// What a session needs to go on elsewhere, beside the frames from 'next_frame' on, which are to be sent again:
// features, pictures and the chains of optical flow follow from them. Plain values; a checkpoint's token is made of it.
struct SessionState {
  // The session goes on with the same network and options, or not at all.
  std::string weights_sha256;  // hex
  FrameEncoding encoding = FrameEncoding::kJpeg;
  ImageSize frame_size;  // of the caller's frames
  ImageSize processing_size;
  int hop_frames = 0;
  int iterations = 0;
  std::optional<double> least_step;  // of EngineOptions; absent: a token older than this field does not say
  bool motion_prior = false;
  bool polish = false;

  int64_t next_frame = 0;  // the first frame to send again
  // Frames up to this one have been taken over. Of what the stream said about points everything before this frame is in
  // here, and nothing that it said at it, which comes again.
  int64_t taken_frame = -1;
  uint64_t next_serial = 0;
  SessionSummary summary;

  struct Patch {  // of a FlowPatch what ReadPatch takes
    FlowPoint at;
    std::string code;
  };
  struct Track {
    TrackState state;
    std::optional<Patch> patch;  // the picture around the query
  };
  std::vector<Track> tracks;         // in the order they were seeded
  std::vector<ObjectState> objects;  // in the order they were queried
};

}  // namespace holdfast
