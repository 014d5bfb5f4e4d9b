// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"

namespace holdfast {

// What a container says of its video.
struct DeclaredVideo {
  int64_t frames = 0;    // 0: nothing says
  bool counted = false;  // 'frames' is a count; else it comes of a length and a rate
  double seconds = 0;    // of the video, or of the longest track where nothing else is known; 0: nothing says
  double fps = 0;        // on average; 0: nothing says
  bool live = false;     // frames come whether somebody takes them or not, and have no numbers of their own
};

// How far a video was read, beside how long it says it is: FFmpeg takes a file that is cut off for one that has ended.
class VideoExtent {
 public:
  VideoExtent(std::string input, const DeclaredVideo& facts);

  // A frame has come; 'at': its time, seconds from the beginning, where it has one.
  void Passed(std::optional<double> at);
  // Between the last frame and the next one something cannot be decoded. DATA_LOSS for what has numbers of its own:
  // they are not known from there on. What a live input has lost is as if it had not come.
  absl::Status Damaged();
  // The input could not be read, which may be its end.
  void CannotBeRead(std::string reason) { failure_ = std::move(reason); }
  // No frame follows. DATA_LOSS where the file itself shows that frames are missing.
  absl::Status End();

  bool live() const { return facts_.live; }
  // What else is odd, which may be right: lengths are inexact, sound may be longer, an edit list may leave frames out,
  // and a screen that stands still may be recorded without frames. Empty: nothing is.
  std::string Doubt() const;

 private:
  bool HasFewGaps() const;

  const std::string input_;
  const DeclaredVideo facts_;
  int64_t passed_ = 0;  // frames
  int64_t damages_ = 0;
  std::optional<double> at_;  // seconds: of the newest frame that has a time
  std::string failure_;       // to read; empty: there was none
  int64_t gaps_ = 0;
  double gap_seconds_ = 0;  // the longest
  int64_t gap_after_ = 0;   // the frame before it
  bool ended_ = false;
};

}  // namespace holdfast
