// SPDX-License-Identifier: Apache-2.0
// Tracks in the formats of other programs. Frames have the numbers of the input. Positions of DeepLabCut and CVAT stay
// as they are: pixels of the video, (0, 0) the centre of the first one; neither format says more about its convention.
// The Python client makes the same files of equal tracks (python/holdfast_client/_export.py).
#pragma once

#include <ostream>

#include "client/cli/track_extent.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"

namespace holdfast {

// In the first two formats, which do not say more about their convention, positions stay as they are: pixels of the
// video, (0, 0) the centre of the first one.

// DeepLabCut's table for one animal: three rows of headings (scorer, bodyparts, coords), then a row for each frame with
// x, y and likelihood of each point, empty where there is no estimate. The likelihood is the confidence, which is low
// where a point is hidden. Body parts are the points' names; a name that came before gets the point's id behind it.
void WriteDeepLabCut(std::ostream& out, const TrackTable& table, const TrackExtent& extent);

// CVAT for video 1.1 (task mode "interpolation"): a track of points for each point, every frame a key frame, hidden
// ones "occluded", and "outside" from where there is no estimate, which is behind the last frame where the input goes
// on, and where it is beyond the picture. A point's label is its name where it has one of its own, else "point"; CVAT
// wants labels that the task has. A point without an estimate is left out, with its label.
void WriteCvat(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent);

// The text format of 3DEqualizer's 2D tracks, which other programs for match-moving read too: the number of points, and
// for each its name, a colour, the number of frames and lines "frame x y". Pixels from the lower left corner of the
// picture, so that ours at (x, y) is at (x + 0.5, height - (y + 0.5)); frames count from 1. Where a point is hidden it
// has no line, as a curve there has no key: what is read is taken for measured.
void Write3de(std::ostream& out, const TrackTable& table, const VideoFacts& video);

}  // namespace holdfast
