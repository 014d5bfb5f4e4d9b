// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"
#include "client/cli/point_file.h"

namespace holdfast {

struct PointOptions {
  std::string file;          // .csv or .json; empty: none
  std::string mask;          // a picture of the frame's size whose nonzero pixels are the object; empty: none
  int grid = 0;              // about so many points on the frame, or exactly so many on the mask; 0: none, 64 on a mask
  int64_t query_frame = -1;  // where the grid's or mask's points start; -1: on the first frame that is tracked

  // OK where at least one source is given.
  absl::Status Validate() const;
};

// The points of all given sources; those of grid or mask get the ids after the file's largest. None starts before
// 'first_frame'.
absl::StatusOr<std::vector<StartPoint>> CollectPoints(const PointOptions& options, ImageSize size,
                                                      int64_t first_frame = 0);

// The centres of about 'count' nearly square cells that tile the frame, row by row.
std::vector<cv::Point2f> GridPoints(int count, ImageSize size);

// 'count' points spread evenly over the nonzero pixels of 'mask' ([H, W] uint8) and away from their border; fewer
// where there are fewer such pixels. The same mask gives the same points.
std::vector<cv::Point2f> MaskPoints(int count, const cv::Mat& mask);

}  // namespace holdfast
