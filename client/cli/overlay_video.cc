// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay_video.h"

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "io/atomic_file.h"

namespace holdfast {
namespace {

constexpr int kHeldQuality = 97;
constexpr int kMostTrailFrames = 10'000;

// As the file's index says, which is written last: a file that lacks its end says none.
int64_t CountFrames(const std::string& path) {
  const cv::VideoCapture video(path, cv::CAP_FFMPEG);
  return video.isOpened() ? static_cast<int64_t>(video.get(cv::CAP_PROP_FRAME_COUNT)) : 0;
}

}  // namespace

absl::Status OverlayVideo::Options::Validate() const {
  if (!video.empty() && !absl::EndsWithIgnoreCase(video, ".mp4")) {
    return absl::InvalidArgumentError(absl::StrCat(video, ": overlay videos end in .mp4"));
  }
  if (!still.empty() && !absl::EndsWithIgnoreCase(still, ".png") && !absl::EndsWithIgnoreCase(still, ".jpg")) {
    return absl::InvalidArgumentError(absl::StrCat(still, ": still pictures end in .png or .jpg"));
  }
  if (trail_frames < 0 || trail_frames > kMostTrailFrames) {
    return absl::InvalidArgumentError(absl::StrCat("--trail_frames: expected 0..", kMostTrailFrames));
  }
  return absl::OkStatus();
}

OverlayVideo::OverlayVideo(Options options, const VideoFacts& video, Show show)
    : options_(std::move(options)), show_(std::move(show)), video_(video), painter_(options_.trail_frames) {}

absl::Status OverlayVideo::Add(const cv::Mat& frame) {
  if (!options_.wanted()) return absl::OkStatus();
  if (!options_.video.empty() && !file_) {
    const absl::Status opened = OpenWriter();
    if (!opened.ok()) return opened;
  }
  std::vector<uint8_t> jpeg;
  try {
    cv::imencode(".jpg", frame, jpeg, {cv::IMWRITE_JPEG_QUALITY, kHeldQuality});
  } catch (const cv::Exception& e) {
    return absl::InternalError(e.err);
  }
  return Hold(std::move(jpeg));
}

absl::Status OverlayVideo::Hold(std::vector<uint8_t> jpeg) {
  ++added_;
  if (!options_.keep_long) {
    held_.push_back(std::move(jpeg));
    return absl::OkStatus();
  }
  if (!spool_) {
    absl::StatusOr<FrameSpool> spool = FrameSpool::Create();
    if (!spool.ok()) return spool.status();
    spool_.emplace(*std::move(spool));
  }
  return spool_->Append({reinterpret_cast<const char*>(jpeg.data()), jpeg.size()});
}

absl::StatusOr<cv::Mat> OverlayVideo::TakeHeld() {
  if (spool_) {
    const absl::StatusOr<std::string> jpeg = spool_->Read(painted_);
    if (!jpeg.ok()) return jpeg.status();
    return cv::imdecode(std::vector<uint8_t>(jpeg->begin(), jpeg->end()), cv::IMREAD_COLOR);
  }
  cv::Mat picture = cv::imdecode(held_.front(), cv::IMREAD_COLOR);
  held_.pop_front();
  return picture;
}

absl::Status OverlayVideo::Paint(const TrackTable& table, int64_t end) {
  for (; painted_ < std::min(end, added_); ++painted_) {
    try {
      absl::StatusOr<cv::Mat> picture = TakeHeld();
      if (!picture.ok()) return picture.status();
      painter_.Paint(table, painted_, *picture);
      Write(table.Number(painted_), *std::move(picture));
    } catch (const cv::Exception& e) {
      return absl::InternalError(absl::StrCat("overlay: ", e.err));
    }
  }
  return absl::OkStatus();
}

absl::Status OverlayVideo::OpenWriter() {
  file_.emplace(options_.video);
  const cv::Size size(video_.size.width, video_.size.height);
  const std::string path = std::filesystem::absolute(file_->temporary()).string();  // where a colon names no protocol
  // H.264 plays everywhere; MPEG-4 part 2 is there where no H.264 encoder is.
  for (const char* codec : {"avc1", "mp4v"}) {
    const int code = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
    if (writer_.open(path, cv::CAP_FFMPEG, code, video_.fps, size)) return absl::OkStatus();
  }
  return absl::UnavailableError(absl::StrCat(options_.video, ": no encoder for H.264 or MPEG-4 can write it"));
}

void OverlayVideo::Write(int64_t number, cv::Mat picture) {
  if (!options_.video.empty()) {
    writer_.write(picture);
    ++written_;
  }
  if (options_.show) show_(picture);
  if (options_.still_frame < 0 || number <= options_.still_frame) still_ = std::move(picture);
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
  absl::Status status = CheckVideo();
  if (status.ok()) status = file_->Commit();
  file_.reset();
  return status;
}

// The writer does not say what it could not write.
absl::Status OverlayVideo::CheckVideo() const {
  try {
    if (CountFrames(std::filesystem::absolute(file_->temporary()).string()) == written_) return absl::OkStatus();
  } catch (const cv::Exception&) {
  }
  return absl::DataLossError(absl::StrCat(options_.video, ": is not whole (is the disk full?)"));
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
