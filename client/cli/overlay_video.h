// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/overlay.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"
#include "io/atomic_file.h"

namespace holdfast {

// Makes the overlay video and the still picture while the tracker runs: holds each frame until it is painted, so that
// memory depends on the tracker's delay and not on the video's length. One thread at a time.
class OverlayVideo {
 public:
  struct Options {
    std::string video;         // .mp4; empty: none
    std::string still;         // .png or .jpg; empty: none
    int64_t still_frame = -1;  // -1, and frames that never come: the last one
    int trail_frames = 20;

    absl::Status Validate() const;
    bool wanted() const { return !video.empty() || !still.empty(); }
  };

  // A video that is not closed is discarded with this object.
  OverlayVideo(Options options, const VideoFacts& video);

  // The next frame of the source. The first one opens the video, so that what cannot be written is known early.
  absl::Status Add(const cv::Mat& frame);
  // Paints the frames held that come before frame 'end' as 'table' has them; they are not painted again.
  absl::Status Paint(const TrackTable& table, int64_t end);
  // Gives the files their names. Frames that are still held are left out; where none was painted no file is written.
  absl::Status Close();

 private:
  absl::Status OpenWriter();
  absl::Status CloseVideo();
  absl::Status CloseStill();
  void Write(cv::Mat picture);

  const Options options_;
  const VideoFacts video_;
  const OverlayPainter painter_;
  std::deque<std::vector<uint8_t>> held_;  // as JPEG: a tenth of the memory
  int64_t painted_ = 0;                    // frames
  std::optional<PendingFile> file_;        // of the open video; outlives its writer
  cv::VideoWriter writer_;
  cv::Mat still_;
};

}  // namespace holdfast
