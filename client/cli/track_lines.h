// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "api/types.h"
#include "client/cli/point_file.h"
#include "client/cli/track_extent.h"

namespace holdfast {

// Estimates as they come, a line of JSON each (NDJSON):
//   {"id", "name", "frame", "x", "y", "visible", "confidence", "final"}
// A later line about the same point and frame takes the place of an earlier one, until one is final. The last line is
//   {"complete", "frames", "final_frames", "expected_frames"}, as in TrackExtent.
// Not thread-safe.
class TrackLines {
 public:
  // 'out' must outlive the object.
  TrackLines(const std::vector<StartPoint>& points, std::ostream& out);

  // Each writes and flushes. False: whoever reads the lines is gone.
  bool Write(const TrackUpdate& update);
  bool End(const TrackExtent& extent);

 private:
  void WriteRun(const PointRun& run);

  absl::flat_hash_map<PointId, std::string> names_;  // as JSON
  std::ostream& out_;
};

}  // namespace holdfast
