// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/track_table.h"
#include "proto/types.h"

namespace holdfast {

// kJson: {width, height, fps, frames, points: [{id, name, frames[], xy[[x, y]], visible[], confidence[]}]}
// kCsv:  id,frame,x,y,visible,confidence
// kNpz:  tracks [N, T, 2] float32 pixels (NaN where absent), visible [N, T] bool, confidence [N, T] float32, ids [N]
// int64
enum class TrackFormat { kJson, kCsv, kNpz };

// By the path's suffix; INVALID_ARGUMENT for others than .json, .csv and .npz.
absl::StatusOr<TrackFormat> TrackFormatOf(absl::string_view path);

struct VideoFacts {
  ImageSize size;
  double fps = 0;
};

// Writes the final estimates of 'table' under 'path', atomically.
absl::Status WriteTracks(const std::string& path, const TrackTable& table, const VideoFacts& video);

}  // namespace holdfast
