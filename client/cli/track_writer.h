// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"
#include "client/cli/track_extent.h"
#include "client/cli/track_table.h"

namespace holdfast {

// T is the number of frames up to the last estimate, and of all frames where the run was complete.
// Frames have the numbers of the input, and 'fps' is of the input, so that number / fps is a time in it.
// kJson: {width, height, fps, frames: T, complete, final_frames, expected_frames,
//         points: [{id, name, frames[], xy[[x, y]], visible[], confidence[]}]}; for inputs whose frames have a capture
//         time also capture_times: [[frame, "2026-01-31T12:00:00.25+00:00"]]; where there is an object also
//         objects: [{id, points[ids], frames[], xy[[x, y]] (its centre), scale[], rotation[], visible[],
//         outline[[[x, y]]], left[[ids]], joined[[ids]]}]; see ObjectSample
// kCsv:  id,frame,x,y,visible,confidence; a line for each estimate and no word on how much is missing; where there is
//        an object also x.objects.csv beside x.csv: object,frame,x,y,scale,rotation,visible,outline,left,joined, where
//        outline is "x y;x y;..." and the last two are ids with spaces between
// kNpz:  tracks [N, T, 2] float32 pixels (NaN where absent), visible [N, T] bool, confidence [N, T] float32,
//        ids [N] int64, names [N] text, query_frames [N] int64 (where each point starts), frames [T] int64 (the number
//        of each column), size [2] int64 (width, height); fps float64, complete bool, final_frames int64 and
//        expected_frames int64 without dimensions; for inputs whose frames have a capture time also capture_times [T]
//        float64, seconds since 1970; where there are O objects (1) also object_ids [O] int64, object_centre
//        [O, T, 2], object_scale, object_rotation and object_visible [O, T] and object_outline [O, T, C, 2] float32
//        (NaN where nothing is known, and behind an outline's last corner), of_object [N] int64 (the object's id, -1:
//        none), replaces [N] int64 (the row of the point in whose place this one was placed anew, -1: none) and left
//        [N, T] bool
// 'complete', 'final_frames' and 'expected_frames' as in TrackExtent.
// kDeepLabCut, kCvat, k3de: see track_exports.h
enum class TrackFormat { kJson, kCsv, kNpz, kDeepLabCut, kCvat, k3de };

// By the path's suffix; INVALID_ARGUMENT for others than .json, .csv, .npz, .dlc.csv (DeepLabCut), .xml (CVAT)
// and .3de.txt (3DEqualizer).
absl::StatusOr<TrackFormat> TrackFormatOf(absl::string_view path);

struct VideoFacts {
  ImageSize size;
  double fps = 0;
};

// x.objects.csv of an x.csv; empty for other formats, which have objects in the file itself or not at all.
std::string ObjectsFileOf(absl::string_view path);

// Writes the estimates of 'table' under 'path', atomically, and after that the table's object where it has a file of
// its own. REQUIRES: extent.frames >= table.estimated_frames().
absl::Status WriteTracks(const std::string& path, const TrackTable& table, const VideoFacts& video,
                         const TrackExtent& extent);

}  // namespace holdfast
