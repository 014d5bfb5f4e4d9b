// SPDX-License-Identifier: Apache-2.0
// Tracks in the formats of other programs. Positions stay as they are: pixels of the video, (0, 0) the centre of the
// first one. Neither format says more about its convention. The Python client makes the same files of equal tracks
// (python/holdfast_client/_export.py).
#pragma once

#include <ostream>

#include "client/cli/track_extent.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"

namespace holdfast {

// DeepLabCut's table for one animal: three rows of headings (scorer, bodyparts, coords), then a row for each frame with
// x, y and likelihood of each point, empty where there is no estimate. The likelihood is the confidence, which is low
// where a point is hidden. Body parts are the points' names; a name that came before gets the point's id behind it.
void WriteDeepLabCut(std::ostream& out, const TrackTable& table, const TrackExtent& extent);

// CVAT for video 1.1 (task mode "interpolation"): a track of points for each point, every frame a key frame, hidden
// ones "occluded", and "outside" from where there is no estimate and where it is beyond the picture. A point's label is
// its name where it has one of its own, else "point"; CVAT wants labels that the task has.
void WriteCvat(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent);

}  // namespace holdfast
