// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"

namespace holdfast {

// A point to track: from where and from when on.
struct StartPoint {
  PointQuery query;   // pixels of the source's frames
  int64_t frame = 0;  // the frame it is queried at, of the input
  std::string name;   // for people; the id where none was given
};

// Reads a .csv or .json file of points. Every point must have an id of its own and lie inside 'size'; one without a
// frame starts on 'first_frame', and none before it. Errors name the file, the line or list element, and the field.
absl::StatusOr<std::vector<StartPoint>> ReadPointFile(const std::string& path, ImageSize size, int64_t first_frame = 0);

// Lines "id,x,y" or "id,x,y,frame"; such a header, empty lines and lines that begin with # are skipped.
absl::StatusOr<std::vector<StartPoint>> ParsePointsCsv(absl::string_view text, ImageSize size, int64_t first_frame = 0);

// [{"id": 1, "x": 2.5, "y": 3, "frame": 0, "name": "nose"}, ...], frame and name optional; or such a list under
// "points" of an object.
absl::StatusOr<std::vector<StartPoint>> ParsePointsJson(absl::string_view text, ImageSize size,
                                                        int64_t first_frame = 0);

}  // namespace holdfast
