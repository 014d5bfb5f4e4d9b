// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/track_lines.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"

namespace holdfast {

// Where the tracks go, as --out names it: a file as WriteTracks takes it, which is written at the end; "-" for lines as
// TrackLines writes them; or nowhere, where it is empty. Not thread-safe.
class TrackOutput {
 public:
  // What is wrong with the name itself.
  static absl::Status ValidatePath(const std::string& path);
  // Whether it can be written.
  static absl::Status Check(const std::string& path);

  // 'lines' must outlive the object. REQUIRES: ValidatePath(path) is OK.
  TrackOutput(std::string path, const std::vector<StartPoint>& points, std::ostream& lines);

  // The table has taken the update.
  absl::Status Write(const TrackUpdate& update, const TrackTable& table);
  absl::Status End(const TrackTable& table, const VideoFacts& video, const TrackExtent& extent);
  // That End writes; empty: none.
  std::string file() const { return lines_ ? "" : path_; }

 private:
  const std::string path_;
  std::optional<TrackLines> lines_;
};

}  // namespace holdfast
