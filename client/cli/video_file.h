// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/clock.h"
#include "client/cli/upright.h"
#include "client/cli/video_extent.h"

struct AVCodecContext;
struct AVFormatContext;
struct AVFrame;
struct AVPacket;
struct AVStream;
struct SwsContext;

namespace holdfast {

// Whether it is opened through a network: rtsp://, http://, or whatever FFmpeg knows.
bool IsAddress(const std::string& input);

// The frames of a file, a pipe ("-": standard input) or an address, as FFmpeg reads them. Its libraries are used
// directly: OpenCV's reader on top of them tells neither damage from the end nor how pictures are mirrored, gives up
// after some hundred packets of sound, and believes containers that count too few frames. One thread at a time.
class VideoFile {
 public:
  // INVALID_ARGUMENT where there is no video that can be read.
  static absl::StatusOr<std::unique_ptr<VideoFile>> Open(const std::string& input);

  // To the next frame; false after the last one. DATA_LOSS where a file is damaged or cut off.
  absl::StatusOr<bool> Advance();
  // [H, W, 3] uint8 BGR, upright: the frame that was advanced to.
  absl::StatusOr<cv::Mat> Picture();

  double fps() const { return fps_; }         // 0: nothing says
  int64_t frames() const { return frames_; }  // as the container counts or its length and rate say; 0: it does not
  bool live() const { return extent_->live(); }
  std::string Doubt() const { return extent_->Doubt(); }

 private:
  struct Free {
    void operator()(AVCodecContext* decoder) const;
    void operator()(AVFormatContext* container) const;
    void operator()(AVFrame* frame) const;
    void operator()(AVPacket* packet) const;
    void operator()(SwsContext* converter) const;
  };
  template <typename T>
  using Owned = std::unique_ptr<T, Free>;

  explicit VideoFile(std::string input);
  absl::Status OpenContainer();
  absl::Status OpenDecoder();
  void ReadFacts();
  void Feed();       // hands the decoder what the container has next
  void MetDamage();  // what cannot be decoded, or read
  absl::StatusOr<bool> Arrived();
  static int IsOverdue(void* file);

  const std::string input_;
  const SystemClock clock_;
  SteadyTime asked_;  // when FFmpeg was last asked for something
  Owned<AVFormatContext> container_;
  Owned<AVCodecContext> decoder_;
  Owned<AVPacket> packet_;
  Owned<AVFrame> frame_;
  Owned<SwsContext> converter_;
  AVStream* stream_ = nullptr;  // of container_
  double fps_ = 0;
  int64_t frames_ = 0;
  Turn turn_;
  std::unique_ptr<VideoExtent> extent_;
  bool began_ = false;     // a picture that needs no other one has come, or any picture
  bool damaged_ = false;   // since the last frame
  int read_failures_ = 0;  // one after the other
};

}  // namespace holdfast
