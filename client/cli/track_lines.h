// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "api/types.h"
#include "client/cli/point_file.h"
#include "client/cli/track_extent.h"
#include "client/cli/track_table.h"

namespace holdfast {

// Estimates as they come, a line of JSON each (NDJSON):
//   {"id", "name", "frame", "x", "y", "visible", "confidence", "final"}
// and of an object, whose outline is in files alone:
//   {"object", "frame", "x", "y", "scale", "rotation", "visible", "left", "joined", "final"}
// each with "capture_time" where the table knows one. A later line about the same point or object and frame takes the
// place of an earlier one, until one is final. The last line is
//   {"complete", "frames", "final_frames", "expected_frames"}, as in TrackExtent.
// Not thread-safe.
class TrackLines {
 public:
  // 'out' must outlive the object.
  TrackLines(const std::vector<StartPoint>& points, std::ostream& out);

  // Each writes and flushes. False: whoever reads the lines is gone. 'table': knows what the input calls the frames.
  bool Write(const TrackUpdate& update, const TrackTable& table);
  bool End(const TrackExtent& extent);

 private:
  std::string Line(const PointRun& run, size_t i, const TrackTable& table);
  static std::string Line(const ObjectRun& run, size_t i, const TrackTable& table);

  absl::flat_hash_map<PointId, std::string> names_;  // as JSON
  std::ostream& out_;
};

}  // namespace holdfast
