// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"

namespace holdfast {

// The frames of a video file, of a directory of pictures or of a camera, one after the other. One thread at a time.
class FrameSource {
 public:
  // 'input': a video file, a directory (its .jpg, .jpeg and .png files in the order of their names, numbers within them
  // by their worth, but those that begin with a dot), "camera:N" or a device such as /dev/video0, an address (rtsp://,
  // http:// or whatever FFmpeg opens), or "-": JPEGs one after the other on standard input (MJPEG). 'first_frame': the
  // number of the frame that Next gives first; those before it are passed over. Reads that frame, so that an input that
  // does not have it is an error here.
  static absl::StatusOr<std::unique_ptr<FrameSource>> Open(const std::string& input, int64_t first_frame = 0);

  // [H, W, 3] uint8 BGR, upright, all of the same size; empty after the last frame. DATA_LOSS for a broken frame that
  // others follow, which a live input leaves out instead, and for a file that is cut off: it has fewer bytes and fewer
  // frames than its container says.
  absl::StatusOr<cv::Mat> Next();
  // Passes over the frame that Next would give, in a fraction of the time; false where there is none.
  absl::StatusOr<bool> Skip();

  ImageSize size() const { return {first_.cols, first_.rows}; }
  double fps() const { return fps_; }  // 30 for a directory, and as a guess where the input does not say
  bool fps_is_guess() const { return fps_is_guess_; }
  int64_t frames() const { return frames_; }  // as the input announces; 0: not known
  // Whether frames come whether somebody takes them or not, as those of cameras and of whatever is no file and does not
  // say how long it is.
  bool live() const { return live_; }
  // In words, empty where there is nothing: which frames a live input has left out; after the last frame, why it may
  // have come too early. Of the thread that reads.
  std::string doubt() const { return reader_.doubt(); }

 private:
  struct Reader {
    std::function<absl::StatusOr<bool>()> advance;      // to the next frame; false: there is none
    std::function<absl::StatusOr<cv::Mat>()> retrieve;  // the frame that is advanced to
    std::function<std::string()> doubt;
  };
  FrameSource(std::string input, Reader reader, double fps, int64_t frames, bool live);
  static absl::StatusOr<std::unique_ptr<FrameSource>> OpenVideo(const std::string& input);
  static absl::StatusOr<std::unique_ptr<FrameSource>> OpenDirectory(const std::string& input);
  static absl::StatusOr<std::unique_ptr<FrameSource>> OpenCamera(const std::string& input);
  absl::Status ReadFirst(int64_t frame);
  absl::StatusOr<cv::Mat> Read();

  const std::string input_;
  const Reader reader_;
  const double fps_;
  const bool fps_is_guess_;
  const int64_t frames_;
  const bool live_;
  cv::Mat first_;
  bool first_is_next_ = true;
  int64_t next_number_ = 0;
};

// How frames travel: made smaller where a limit says so, and as JPEG.
class FrameEncoder {
 public:
  // 'max_side': of the pictures that are sent, in pixels; 0: as they are. 'jpeg_quality': 1..100.
  FrameEncoder(ImageSize size, int max_side, int jpeg_quality);

  absl::StatusOr<std::string> Encode(const cv::Mat& frame) const;

  // Positions in the source's pixels <-> positions in the sent picture's. Pictures are made smaller edge to edge, so
  // the centre of the first pixel, (0, 0), comes to lie elsewhere: a fourth of a pixel before the smaller one's at half
  // the size. A point that would lie beyond the centres of the sent picture's outer pixels is moved there, as servers
  // want.
  PointQuery ToSent(const PointQuery& point) const;
  void FromSent(PointRun& run) const;
  // The mask becomes one of the sent picture's size.
  absl::StatusOr<ObjectQuery> ToSent(const ObjectQuery& object) const;
  void FromSent(ObjectRun& run) const;
  ImageSize sent_size() const { return sent_; }

 private:
  Pixel FromSent(Pixel sent) const;

  const ImageSize size_;
  const ImageSize sent_;
  const int jpeg_quality_;
};

}  // namespace holdfast
