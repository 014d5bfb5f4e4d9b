// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/point_tracker.h"
#include "api/types.h"
#include "client/cli/hop_bounds.h"
#include "client/cli/overlay_video.h"
#include "client/cli/picture_window.h"
#include "client/cli/point_source.h"
#include "program/termination.h"

namespace holdfast {

struct TrackOptions {
  std::string input;  // as FrameSource::Open takes it
  PointOptions points;
  std::string out;  // as TrackOutput takes it
  OverlayVideo::Options overlay;
  int64_t start_frame = 0;  // of the input: the first one that is tracked
  int64_t every = 1;        // from there on every so-many-th, and those that points start on
  int64_t max_frames = 0;   // that are tracked; 0: all
  bool both = false;        // points are tracked from their queries back to the first frame too
  int max_side = 0;         // of the frames sent, pixels; 0: as they are
  int jpeg_quality = 92;
  ImageSize processing_size;  // empty: the server's default
  HopBounds hop;
  int iterations = 0;      // 0: the server's default
  double promise_fps = 0;  // that the server is to promise; 0: the pace that it has time for
  // Asks for an estimate on every frame, and shows those; 'out' holds final ones all the same. Of an input that does
  // not wait, frames are left out instead of queued.
  bool live = false;

  // What is wrong with the call itself, before any file is opened.
  absl::Status Validate() const;
};

// What a run needs from outside.
struct TrackEnvironment {
  // Called once the input and the points are known to be good.
  std::function<absl::StatusOr<std::unique_ptr<PointTracker>>()> connect;
  StopSignal& stop;   // cancels the session; listened to from the accepted session to the written files
  std::ostream& out;  // lines of estimates, where they are asked for
  std::ostream& log;  // progress and what was written
  bool terminal;      // whether 'log' is one
  // Called, where pictures are to be shown, before the input is opened; 'quit' as OpenPictureWindow takes it.
  std::function<absl::StatusOr<std::unique_ptr<PictureView>>(std::function<void()> quit)> open_view;
};

// Tracks the points through the input and writes the files. When the session is lost, the input breaks or 'stop' comes,
// the files hold every estimate that was received, final or not, 'log' says which frames these are, and the status says
// why; CANCELLED is for 'stop' alone. Without any estimate no file is written or replaced. Outputs that cannot be
// written are found before the input is opened. REQUIRES: options.Validate() is OK.
absl::Status RunTrack(const TrackOptions& options, const TrackEnvironment& environment);

}  // namespace holdfast
