// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/frame_spool.h"
#include "client/cli/overlay.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"
#include "io/atomic_file.h"

namespace holdfast {

// Makes the overlay video, the still picture and what a window shows while the tracker runs: holds each frame until it
// is painted, so that memory depends on the tracker's delay and not on the video's length. One thread at a time.
class OverlayVideo {
 public:
  struct Options {
    std::string video;         // .mp4; empty: none
    std::string still;         // .png or .jpg; empty: none
    int64_t still_frame = -1;  // of the input; -1, and frames that never come: the last one
    int trail_frames = 20;
    bool show = false;       // in a window, as soon as they are painted
    bool keep_long = false;  // frames are painted long after they came: holds them in a file

    absl::Status Validate() const;
    bool wanted() const { return !video.empty() || !still.empty() || show; }
  };
  using Show = std::function<void(const cv::Mat& picture)>;

  // 'show': gets every painted picture where that is asked for. A video that is not closed is discarded with this
  // object.
  OverlayVideo(Options options, const VideoFacts& video, Show show = nullptr);

  // The next frame of the source. The first one opens the video, so that what cannot be written is known early.
  absl::Status Add(const cv::Mat& frame);
  // Paints the frames held that come before frame 'end' as 'table' has them; they are not painted again.
  absl::Status Paint(const TrackTable& table, int64_t end);
  // Gives the files their names. Frames that are still held are left out; where none was painted no file is written.
  // DATA_LOSS for a video that does not have every painted frame, as on a full disk; an older file stays.
  absl::Status Close();

 private:
  absl::Status OpenWriter();
  absl::Status CloseVideo();
  absl::Status CheckVideo() const;
  absl::Status CloseStill();
  absl::Status Hold(std::vector<uint8_t> jpeg);
  absl::StatusOr<cv::Mat> TakeHeld();
  void Write(int64_t number, cv::Mat picture);

  const Options options_;
  const Show show_;
  const VideoFacts video_;
  const OverlayPainter painter_;
  std::deque<std::vector<uint8_t>> held_;  // as JPEG: a tenth of the memory
  std::optional<FrameSpool> spool_;        // of all frames, instead of 'held_'
  int64_t added_ = 0;                      // frames
  int64_t painted_ = 0;                    // frames
  std::optional<PendingFile> file_;        // of the open video; outlives its writer
  cv::VideoWriter writer_;
  int64_t written_ = 0;  // frames
  cv::Mat still_;
};

}  // namespace holdfast
