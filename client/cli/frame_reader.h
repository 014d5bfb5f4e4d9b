// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <thread>

#include "absl/status/statusor.h"
#include "client/cli/video.h"

namespace holdfast {

// Reads a few frames ahead on a thread of its own, so that whoever waits for a camera that stalls or for a pipe that
// nobody fills can be freed. One thread at a time may call Next; Stop may be called from any thread.
class FrameReader {
 public:
  explicit FrameReader(std::unique_ptr<FrameSource> source);
  // Waits half a second for a read that is going on; then its thread keeps the source and ends when the read returns.
  // A program that ends before that must not run the destructors of globals (see std::_Exit).
  ~FrameReader();

  // As FrameSource::Next, and CANCELLED after Stop.
  absl::StatusOr<cv::Mat> Next();
  void Stop();

 private:
  struct Shared;
  static void ReadToTheEnd(Shared& shared);

  const std::shared_ptr<Shared> shared_;
  std::thread thread_;
};

}  // namespace holdfast
