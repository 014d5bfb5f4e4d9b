// SPDX-License-Identifier: Apache-2.0
#include "client/cli/video.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "api/clock.h"
#include "client/cli/container_file.h"
#include "client/cli/declared_length.h"
#include "client/cli/upright.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr double kDefaultFps = 30;
constexpr double kMostFps = 20'000;                     // of high-speed cameras
constexpr double kDoubtfulFps = 1000;                   // from here on FFmpeg may give a clock's ticks for a rate
constexpr int kAttempts = 1000;                         // to find a picture behind damaged ones
constexpr absl::Duration kPatience = absl::Seconds(1);  // with an input that may wait for each of them
constexpr char kCameraPrefix[] = "camera:";

bool IsPicture(const fs::path& path) {
  const std::string suffix = absl::AsciiStrToLower(path.extension().string());
  if (absl::StartsWith(path.filename().string(), ".")) return false;  // "._0001.jpg": what macOS keeps of 0001.jpg
  return suffix == ".jpg" || suffix == ".jpeg" || suffix == ".png";
}

// A number, or a single character that is none.
absl::string_view PartAt(absl::string_view name, size_t at) {
  size_t end = at;
  while (end < name.size() && absl::ascii_isdigit(name[end])) ++end;
  return name.substr(at, std::max<size_t>(1, end - at));
}

absl::string_view WithoutZeros(absl::string_view number) {
  while (absl::ConsumePrefix(&number, "0")) {
  }
  return number;
}

// Whether a name comes first where people count: numbers within names by what they are worth, so that 2 is before 10.
bool ComesBefore(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    const absl::string_view part_a = PartAt(a, i), part_b = PartAt(b, j);
    const absl::string_view worth_a = WithoutZeros(part_a), worth_b = WithoutZeros(part_b);
    if (worth_a.size() != worth_b.size() && absl::ascii_isdigit(a[i]) && absl::ascii_isdigit(b[j])) {
      return worth_a.size() < worth_b.size();
    }
    if (worth_a != worth_b) return worth_a < worth_b;
    i += part_a.size();
    j += part_b.size();
  }
  const bool a_ends = i == a.size(), b_ends = j == b.size();
  return a_ends == b_ends ? a < b : a_ends;
}

bool IsRate(double fps) { return std::isfinite(fps) && fps > 0 && fps <= kMostFps; }

template <typename Call>
auto WithoutException(const std::string& name, const Call& call) -> absl::StatusOr<decltype(call())> {
  try {
    return call();
  } catch (const cv::Exception& e) {
    return absl::DataLossError(absl::StrCat(name, ": ", e.err));
  }
}

int Scaled(int side, double factor) { return std::max(1, static_cast<int>(std::lround(side * factor))); }

ImageSize Limited(ImageSize size, int max_side) {
  const int side = std::max(size.width, size.height);
  if (max_side == 0 || side <= max_side) return size;
  const double factor = static_cast<double>(max_side) / side;
  return {Scaled(size.width, factor), Scaled(size.height, factor)};
}

// Where a coordinate of a picture with a side of 'from' pixels lies in one of 'to' pixels.
float Resized(float at, int from, int to) {
  constexpr double kEdge = 0.5;  // pixels, from it to the centre of the first one
  return static_cast<float>((at + kEdge) * to / from - kEdge);
}

// FFmpeg looks at megabytes or seconds of a stream before it gives a frame, unless it is told not to; that a user told
// it something wins.
void TakeFramesAtOnce() { setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", "probesize;32|analyzeduration;0", /*overwrite=*/0); }

bool IsAddress(const std::string& input) { return absl::StrContains(input, "://"); }

// FFmpeg takes what stands before a colon for a protocol, but in an absolute path.
std::string NameForFfmpeg(const std::string& input) {
  if (input == "-") return "pipe:0";
  return IsAddress(input) ? input : fs::absolute(input).string();
}

// A character device of the system's: what lies beside them, as a file in /dev/shm or what a shell gives in place of a
// name, is read as any other file or pipe.
bool IsCamera(const std::string& input) {
  if (absl::StartsWith(input, kCameraPrefix)) return true;
  if (!absl::StartsWith(input, "/dev/") || input == "/dev/stdin" || absl::StartsWith(input, "/dev/fd/")) return false;
  std::error_code ignored;
  return fs::is_character_file(input, ignored);
}

// By the times of a file's first frames; 0: they do not say.
double MeasuredFps(const std::string& input) {
  constexpr int kFrames = 30;
  cv::VideoCapture capture(NameForFfmpeg(input), cv::CAP_FFMPEG);
  double last = 0;
  int steps = -1;
  for (; steps < kFrames && capture.grab(); ++steps) last = std::max(last, capture.get(cv::CAP_PROP_POS_MSEC) / 1000);
  return last > 0 ? steps / last : 0;
}

// Whether there is a next frame. One that cannot be decoded looks like the end, but further ones come behind it.
bool Grab(cv::VideoCapture& capture, bool live, bool* damaged) {
  if (capture.grab()) return true;
  const SystemClock clock;
  const SteadyTime failed = clock.SteadyNow();
  for (int i = 0; i < kAttempts && (!live || clock.Since(failed) < kPatience); ++i) {
    if (capture.grab()) return *damaged = true;
  }
  return false;
}

// Whether OpenCV has the number of frames from the container, and not from its length and rate.
bool CountsItsFrames(const std::string& input) {
  ContainerFile file(input);
  return IsMp4(file) || file.Read(0, 4) == "RIFF";
}

// JPEGs one after the other, which know no time: FFmpeg takes them for 25 a second.
bool IsRawMjpeg(const std::string& input) {
  constexpr absl::string_view kJpeg = "\xFF\xD8\xFF";
  return input == "-" || ContainerFile(input).Read(0, kJpeg.size()) == kJpeg;
}

// What OpenCV says, unless that may be the ticks of the container's clock and the frames come at another pace.
absl::StatusOr<double> FpsOf(const std::string& input, double said) {
  if (IsRawMjpeg(input)) return 0;
  if (said < kDoubtfulFps) return said;
  std::error_code ignored;
  if (!fs::is_regular_file(input, ignored)) return 0;  // what is read once
  const auto measured = WithoutException(input, [&] { return MeasuredFps(input); });
  if (!measured.ok()) return measured.status();
  return std::abs(*measured - said) < 0.1 * said ? said : *measured;
}

}  // namespace

// How far a video was read, beside how long it says it is: FFmpeg takes a file that is cut off for one that has ended.
class FrameSource::VideoExtent {
 public:
  // Of the container; 0 or less: not known. 'seconds' is its longest track's, which may be one of sound.
  VideoExtent(std::string input, int64_t frames, double seconds)
      : input_(std::move(input)), frames_(frames), seconds_(seconds) {}

  // 'at': the frame's time; 0 where it has none, as the last ones of a video whose frames are stored out of order.
  void Passed(double at) {
    ++passed_;
    at_ = std::max(at_, at);
  }
  // Between the last frame and the next one something cannot be decoded. DATA_LOSS for what has numbers of its own:
  // they are not known from there on. What a live input has lost is as if it had not come.
  absl::Status Damaged() {
    ++damages_;
    if (live()) return absl::OkStatus();
    if (LacksItsEnd(input_)) return End();  // by what is left of its last frame
    return absl::DataLossError(absl::StrFormat("%s: is damaged: frame %d cannot be decoded", input_, passed_));
  }
  bool live() const { return frames_ <= 0; }
  // DATA_LOSS where the file itself shows that frames are missing.
  absl::Status End() {
    ended_ = true;
    if (passed_ >= frames_) return absl::OkStatus();
    lacks_frames_ = CountsItsFrames(input_);
    if (!LacksItsEnd(input_)) return absl::OkStatus();
    return absl::DataLossError(
        absl::StrFormat("%s: is cut off: it ends after %d of %d frames", input_, passed_, frames_));
  }
  // What else is odd, which may be right about the end: lengths are inexact, sound may be longer, and an edit list may
  // leave frames out. Empty: nothing is.
  std::string Doubt() const {
    if (damages_ > 0) {
      return absl::StrFormat("%s: is damaged, at %d place%s; pictures were left out there", input_, damages_,
                             damages_ == 1 ? "" : "s");
    }
    if (lacks_frames_) {
      return absl::StrFormat("%s: gave %d of %d frames; is it damaged, or does an edit list leave some out?", input_,
                             passed_, frames_);
    }
    if (!ended_ || at_ <= 0 || at_ + std::max(1.0, 0.1 * seconds_) >= seconds_) return "";
    return absl::StrFormat("%s: its pictures end at %.1f of %.1f seconds; is it damaged, or its sound longer?", input_,
                           at_, seconds_);
  }

 private:
  const std::string input_;
  const int64_t frames_;
  const double seconds_;
  int64_t passed_ = 0;  // frames
  int64_t damages_ = 0;
  double at_ = 0;  // seconds
  bool ended_ = false;
  bool lacks_frames_ = false;
};

FrameSource::FrameSource(std::string input, Reader reader, double fps, int64_t frames)
    : input_(std::move(input)),
      reader_(std::move(reader)),
      fps_(IsRate(fps) ? fps : kDefaultFps),
      fps_is_guess_(!IsRate(fps)),
      frames_(std::max<int64_t>(0, frames)) {}

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::Open(const std::string& input, int64_t first_frame) {
  std::error_code ignored;
  const bool camera = IsCamera(input);
  const bool stream = input == "-" || IsAddress(input);
  if (!camera && !stream && !fs::exists(input, ignored))
    return absl::NotFoundError(absl::StrCat(input, ": no such file"));
  auto source = camera ? OpenCamera(input) : fs::is_directory(input, ignored) ? OpenDirectory(input) : OpenVideo(input);
  if (!source.ok()) return source.status();
  if (absl::Status status = (*source)->ReadFirst(first_frame); !status.ok()) return status;
  return source;
}

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::OpenVideo(const std::string& input) {
  auto capture = std::make_shared<cv::VideoCapture>();
  if (input == "-") TakeFramesAtOnce();
  const auto opened = WithoutException(input, [&] { return capture->open(NameForFfmpeg(input), cv::CAP_FFMPEG); });
  if (!opened.ok()) return opened.status();
  if (!*opened) return absl::InvalidArgumentError(absl::StrCat(input, ": is not a video that can be read"));
  const double fps = capture->get(cv::CAP_PROP_FPS), frames = capture->get(cv::CAP_PROP_FRAME_COUNT);
  // Where a file does not count its frames OpenCV has taken them from its length and an average rate that may be wrong.
  const double seconds = std::isfinite(frames / fps) ? frames / fps : 0;
  const absl::StatusOr<double> rate = FpsOf(input, fps);
  if (!rate.ok()) return rate.status();
  const VideoExtent extent(input, std::llround(frames), seconds);
  const Turn turn = TakeOverTurn(input, *capture);
  return std::unique_ptr<FrameSource>(
      new FrameSource(input, ReaderOf(input, capture, turn, extent), *rate, std::llround(frames)));
}

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::OpenDirectory(const std::string& input) {
  std::vector<std::string> paths;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(input, error)) {
    if (IsPicture(entry.path())) paths.push_back(entry.path().string());
  }
  if (error) return absl::PermissionDeniedError(absl::StrCat(input, ": ", error.message()));
  if (paths.empty()) return absl::NotFoundError(absl::StrCat(input, ": the directory has no .jpg or .png file"));
  std::sort(paths.begin(), paths.end(), ComesBefore);
  const auto count = static_cast<int64_t>(paths.size());
  auto next = std::make_shared<size_t>(0);
  const auto advance = [next, count] { return static_cast<int64_t>((*next)++) < count; };
  const auto retrieve = [paths = std::move(paths), next]() -> absl::StatusOr<cv::Mat> {
    const std::string& path = paths[*next - 1];
    absl::StatusOr<cv::Mat> frame = WithoutException(path, [&path] { return cv::imread(path, cv::IMREAD_COLOR); });
    if (frame.ok() && frame->empty()) return absl::DataLossError(absl::StrCat(path, ": is not a picture"));
    return frame;
  };
  return std::unique_ptr<FrameSource>(
      new FrameSource(input, {advance, retrieve, [] { return ""; }}, kDefaultFps, count));
}

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::OpenCamera(const std::string& input) {
  absl::string_view text = input;
  int number = -1;
  if (absl::ConsumePrefix(&text, kCameraPrefix) && (!absl::SimpleAtoi(text, &number) || number < 0)) {
    return absl::InvalidArgumentError(absl::StrCat(input, ": expected camera:0, camera:1, ..."));
  }
  const std::string device = number < 0 ? input : absl::StrCat("/dev/video", number);
  auto capture = std::make_shared<cv::VideoCapture>();
  if (!capture->open(device, cv::CAP_V4L2))
    return absl::NotFoundError(absl::StrCat(input, ": no camera answers there"));
  return std::unique_ptr<FrameSource>(new FrameSource(input, ReaderOf(input, capture, {}, VideoExtent(input, 0, 0)),
                                                      capture->get(cv::CAP_PROP_FPS), 0));
}

FrameSource::Reader FrameSource::ReaderOf(const std::string& input, const std::shared_ptr<cv::VideoCapture>& capture,
                                          const Turn& turn, const VideoExtent& length) {
  const auto extent = std::make_shared<VideoExtent>(length);
  const auto advance = [input, capture, extent]() -> absl::StatusOr<bool> {
    bool damaged = false;
    absl::StatusOr<bool> grabbed = WithoutException(input, [&] { return Grab(*capture, extent->live(), &damaged); });
    if (!grabbed.ok()) return grabbed;
    if (absl::Status whole = damaged ? extent->Damaged() : absl::OkStatus(); !whole.ok()) return whole;
    if (*grabbed) {
      extent->Passed(capture->get(cv::CAP_PROP_POS_MSEC) / 1000);
    } else if (absl::Status whole = extent->End(); !whole.ok()) {
      return whole;
    }
    return grabbed;
  };
  const auto retrieve = [input, capture, turn] {
    return WithoutException(input, [&] {
      cv::Mat frame;
      capture->retrieve(frame);
      const cv::Mat turned = Turned(frame, turn);
      return turned.data == frame.data ? frame.clone() : turned;  // the next frame reuses the memory
    });
  };
  return {advance, retrieve, [extent] { return extent->Doubt(); }};
}

absl::Status FrameSource::ReadFirst(int64_t frame) {
  for (; next_number_ < frame; ++next_number_) {
    const absl::StatusOr<bool> passed = reader_.advance();
    if (!passed.ok()) return passed.status();
    if (!*passed) break;
  }
  absl::StatusOr<cv::Mat> first = next_number_ < frame ? cv::Mat() : Read();
  if (!first.ok()) return first.status();
  if (first->empty() && frame > 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(input_, ": has no frame ", frame, ", it ends after ", next_number_, " frames"));
  }
  if (first->empty()) return absl::InvalidArgumentError(absl::StrCat(input_, ": has no frames that can be read"));
  first_ = *std::move(first);
  return absl::OkStatus();
}

// A camera's picture that is damaged is left out.
absl::StatusOr<cv::Mat> FrameSource::Read() {
  for (int i = 0; i < (live() ? kAttempts : 1); ++i) {
    const absl::StatusOr<bool> advanced = reader_.advance();
    if (!advanced.ok()) return advanced.status();
    if (!*advanced) return cv::Mat();
    absl::StatusOr<cv::Mat> frame = reader_.retrieve();
    if (!frame.ok() || !frame->empty()) return frame;
  }
  return absl::DataLossError(absl::StrCat(input_, ": is damaged: a picture cannot be decoded"));
}

absl::StatusOr<cv::Mat> FrameSource::Next() {
  const int64_t number = next_number_++;
  if (std::exchange(first_is_next_, false)) return first_;
  absl::StatusOr<cv::Mat> frame = Read();
  if (!frame.ok() || frame->empty() || frame->size() == first_.size()) return frame;
  return absl::DataLossError(absl::StrCat(input_, ": frame ", number, " is ", frame->cols, "x", frame->rows,
                                          ", the frames before it are ", first_.cols, "x", first_.rows));
}

absl::StatusOr<bool> FrameSource::Skip() {
  ++next_number_;
  return std::exchange(first_is_next_, false) ? true : reader_.advance();
}

FrameEncoder::FrameEncoder(ImageSize size, int max_side, int jpeg_quality)
    : size_(size), sent_(Limited(size, max_side)), jpeg_quality_(jpeg_quality) {}

absl::StatusOr<std::string> FrameEncoder::Encode(const cv::Mat& frame) const {
  std::vector<uint8_t> bytes;
  const auto encoded = WithoutException("JPEG", [&] {
    cv::Mat picture = frame;
    if (sent_ != size_) cv::resize(frame, picture, {sent_.width, sent_.height}, 0, 0, cv::INTER_AREA);
    cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality_});
    return picture;
  });
  if (!encoded.ok()) return encoded.status();
  return std::string(bytes.begin(), bytes.end());
}

PointQuery FrameEncoder::ToSent(const PointQuery& point) const {
  const float x = Resized(point.x, size_.width, sent_.width);
  const float y = Resized(point.y, size_.height, sent_.height);
  return {point.id, std::clamp(x, 0.0f, static_cast<float>(sent_.width - 1)),
          std::clamp(y, 0.0f, static_cast<float>(sent_.height - 1))};
}

absl::StatusOr<ObjectQuery> FrameEncoder::ToSent(const ObjectQuery& object) const {
  if (sent_ == size_) return object;
  ObjectQuery sent = object;
  std::vector<uint8_t> png;
  const auto encoded = WithoutException("PNG", [&] {
    cv::Mat mask =
        cv::imdecode(std::vector<uint8_t>(object.mask_png.begin(), object.mask_png.end()), cv::IMREAD_GRAYSCALE);
    // By pixel centres, as the pictures; INTER_NEAREST takes corners for them.
    cv::resize(mask, mask, {sent_.width, sent_.height}, 0, 0, cv::INTER_NEAREST_EXACT);
    cv::imencode(".png", mask, png);
    return mask;
  });
  if (!encoded.ok()) return encoded.status();
  sent.mask_png.assign(png.begin(), png.end());
  return sent;
}

Pixel FrameEncoder::FromSent(Pixel sent) const {
  return {Resized(sent.x, sent_.width, size_.width), Resized(sent.y, sent_.height, size_.height)};
}

void FrameEncoder::FromSent(ObjectRun& run) const {
  for (ObjectSample& sample : run.samples) {
    sample.centre = FromSent(sample.centre);
    for (Pixel& corner : sample.outline) corner = FromSent(corner);
  }
}

void FrameEncoder::FromSent(PointRun& run) const {
  for (float& x : run.x) x = Resized(x, sent_.width, size_.width);
  for (float& y : run.y) y = Resized(y, sent_.height, size_.height);
}

}  // namespace holdfast
