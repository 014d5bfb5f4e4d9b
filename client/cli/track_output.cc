// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_output.h"

#include <utility>

#include "io/atomic_file.h"

namespace holdfast {
namespace {

bool IsStream(const std::string& path) { return path == "-"; }

absl::Status ReaderIsGone() { return absl::DataLossError("standard output takes no more lines"); }

}  // namespace

absl::Status TrackOutput::ValidatePath(const std::string& path) {
  return path.empty() || IsStream(path) ? absl::OkStatus() : TrackFormatOf(path).status();
}

absl::Status TrackOutput::Check(const std::string& path) {
  return path.empty() || IsStream(path) ? absl::OkStatus() : CheckWritable(path);
}

TrackOutput::TrackOutput(std::string path, const std::vector<StartPoint>& points, std::ostream& lines)
    : path_(std::move(path)) {
  if (IsStream(path_)) lines_.emplace(points, lines);
}

absl::Status TrackOutput::Write(const TrackUpdate& update, const TrackTable& table) {
  return !lines_ || lines_->Write(update, table) ? absl::OkStatus() : ReaderIsGone();
}

absl::Status TrackOutput::End(const TrackTable& table, const VideoFacts& video, const TrackExtent& extent) {
  if (lines_) return lines_->End(extent) ? absl::OkStatus() : ReaderIsGone();
  return path_.empty() ? absl::OkStatus() : WriteTracks(path_, table, video, extent);
}

}  // namespace holdfast
