// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay_video.h"

#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"

namespace holdfast {
namespace {

constexpr int kHeldQuality = 97;

}  // namespace

absl::Status OverlayVideo::Options::Validate() const {
  if (!video.empty() && !absl::EndsWithIgnoreCase(video, ".mp4")) {
    return absl::InvalidArgumentError(absl::StrCat(video, ": overlay videos end in .mp4"));
  }
  if (!still.empty() && !absl::EndsWithIgnoreCase(still, ".png") && !absl::EndsWithIgnoreCase(still, ".jpg")) {
    return absl::InvalidArgumentError(absl::StrCat(still, ": still pictures end in .png or .jpg"));
  }
  return absl::OkStatus();
}

OverlayVideo::OverlayVideo(Options options, const VideoFacts& video)
    : options_(std::move(options)), video_(video), painter_(options_.trail_frames) {}

absl::Status OverlayVideo::Add(const cv::Mat& frame) {
  if (!options_.wanted()) return absl::OkStatus();
  if (!options_.video.empty() && !file_) {
    const absl::Status opened = OpenWriter();
    if (!opened.ok()) return opened;
  }
  try {
    held_.emplace_back();
    cv::imencode(".jpg", frame, held_.back(), {cv::IMWRITE_JPEG_QUALITY, kHeldQuality});
  } catch (const cv::Exception& e) {
    return absl::InternalError(e.err);
  }
  return absl::OkStatus();
}

absl::Status OverlayVideo::Paint(const TrackTable& table, int64_t end) {
  for (; painted_ < end && !held_.empty(); ++painted_) {
    try {
      cv::Mat picture = cv::imdecode(held_.front(), cv::IMREAD_COLOR);
      held_.pop_front();
      painter_.Paint(table, painted_, picture);
      Write(std::move(picture));
    } catch (const cv::Exception& e) {
      return absl::InternalError(absl::StrCat("overlay: ", e.err));
    }
  }
  return absl::OkStatus();
}

absl::Status OverlayVideo::OpenWriter() {
  file_.emplace(options_.video);
  const cv::Size size(video_.size.width, video_.size.height);
  // H.264 plays everywhere; MPEG-4 part 2 is there where no H.264 encoder is.
  for (const char* codec : {"avc1", "mp4v"}) {
    const int code = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
    if (writer_.open(file_->temporary(), cv::CAP_FFMPEG, code, video_.fps, size)) return absl::OkStatus();
  }
  return absl::UnavailableError(absl::StrCat(options_.video, ": no encoder for H.264 or MPEG-4 can write it"));
}

void OverlayVideo::Write(cv::Mat picture) {
  if (!options_.video.empty()) writer_.write(picture);
  if (options_.still_frame < 0 || painted_ <= options_.still_frame) still_ = std::move(picture);
}

absl::Status OverlayVideo::Close() {
  if (painted_ == 0) return absl::OkStatus();
  absl::Status status = CloseVideo();
  status.Update(CloseStill());
  return status;
}

absl::Status OverlayVideo::CloseVideo() {
  if (!file_) return absl::OkStatus();
  writer_.release();
  const absl::Status status = file_->Commit();
  file_.reset();
  return status;
}

absl::Status OverlayVideo::CloseStill() {
  if (options_.still.empty() || still_.empty()) return absl::OkStatus();
  return WriteAtomically(options_.still, [this](const std::string& temporary) {
    try {
      if (cv::imwrite(temporary, still_)) return absl::OkStatus();
    } catch (const cv::Exception&) {
    }
    return absl::InternalError("cannot be written");
  });
}

}  // namespace holdfast
