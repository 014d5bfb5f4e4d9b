// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"
#include "client/cli/point_file.h"

namespace holdfast {

struct PointOptions {
  std::string file;  // .csv or .json; empty: none
  std::string mask;  // a picture of the frame's size whose nonzero pixels are an object; empty: none
  int grid = 0;      // about so many points on the frame, or so many on the mask's object; 0: none, 64 on an object
  int64_t query_frame = -1;  // where the grid's points or the object start; -1: on the first frame that is tracked
  bool reseed = true;        // points that have left the mask's object are placed anew

  // OK where at least one source is given.
  absl::Status Validate() const;
};

// The points of file and grid; those of the grid get the ids after the file's largest. None starts before
// 'first_frame'.
absl::StatusOr<std::vector<StartPoint>> CollectPoints(const PointOptions& options, ImageSize size,
                                                      int64_t first_frame = 0);

// An object to track, whose points the server places.
struct StartObject {
  ObjectQuery query;        // its mask has the size of the source's frames
  int64_t frame = 0;        // the input's, that it is queried at
  PointId first_point = 1;  // its points get the ids from here on
};

// The mask's; empty: there is none. 'points' are those of the other sources.
absl::StatusOr<std::optional<StartObject>> CollectObject(const PointOptions& options, ImageSize size,
                                                         const std::vector<StartPoint>& points,
                                                         int64_t first_frame = 0);

// The centres of about 'count' nearly square cells that tile the frame, row by row.
std::vector<cv::Point2f> GridPoints(int count, ImageSize size);

}  // namespace holdfast
