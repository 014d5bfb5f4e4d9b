// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <thread>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/cli/frame_choice.h"
#include "client/cli/video.h"

namespace holdfast {

struct InputFrame {
  int64_t number = 0;                      // in the input
  cv::Mat picture;                         // [H, W, 3] uint8 BGR; empty behind the last frame
  std::optional<absl::Time> capture_time;  // of a live input: when the frame was read
  std::string doubt;                       // as FrameSource::doubt
};

// Reads the chosen frames of an input, a few ahead, on a thread of its own, so that whoever waits for a camera that
// stalls or for a pipe that nobody fills can be freed. One thread at a time may call Next; the others may be called
// from any thread.
class FrameReader {
 public:
  struct Options {
    FrameChoice choice{0, 1, {}};  // its first frame is the source's
    // The input is read whether frames are taken or not; when it is ahead the oldest that nobody took is left out, so
    // that Next gives what is new. No frame that points start on is left out.
    bool drop = false;
  };

  FrameReader(std::unique_ptr<FrameSource> source, Options options);
  // Waits half a second for a read that is going on; then its thread keeps the source and ends when the read returns.
  // A program that ends before that must not run the destructors of globals (see std::_Exit).
  ~FrameReader();

  // As FrameSource::Next, and CANCELLED after Stop.
  absl::StatusOr<InputFrame> Next();
  void Stop();
  int64_t dropped() const;  // frames left out because nobody took them

 private:
  struct Shared;
  static void ReadToTheEnd(Shared& shared);

  const std::shared_ptr<Shared> shared_;
  std::thread thread_;
};

}  // namespace holdfast
