// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "api/point_tracker.h"
#include "client/cli/picture_window.h"
#include "client/cli/point_file.h"
#include "client/cli/point_source.h"
#include "client/cli/track_command.h"
#include "client/cli/video.h"

namespace holdfast {

// What RunTrack has found good.
struct TrackInputs {
  std::unique_ptr<FrameSource> source;
  std::vector<StartPoint> points;
  std::optional<StartObject> object;
  PictureView* view = nullptr;  // null where nothing is shown; not owned
};

// The part of RunTrack from the first frame to the written files.
absl::Status TrackInput(const TrackOptions& options, const TrackEnvironment& environment, TrackInputs inputs,
                        PointTracker& tracker);

}  // namespace holdfast
