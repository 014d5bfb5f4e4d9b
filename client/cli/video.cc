// SPDX-License-Identifier: Apache-2.0
#include "client/cli/video.h"

#include <algorithm>
#include <cmath>
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
#include "absl/strings/strip.h"
#include "api/clock.h"
#include "client/cli/video_file.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr double kDefaultFps = 30;
constexpr double kMostFps = 20'000;                     // of high-speed cameras
constexpr int kAttempts = 1000;                         // to find a camera's picture behind damaged ones
constexpr absl::Duration kPatience = absl::Seconds(1);  // with a camera that gives none for now
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

// A character device of the system's: what lies beside them, as a file in /dev/shm or what a shell gives in place of a
// name, is read as any other file or pipe.
bool IsCamera(const std::string& input) {
  if (absl::StartsWith(input, kCameraPrefix)) return true;
  if (!absl::StartsWith(input, "/dev/") || input == "/dev/stdin" || absl::StartsWith(input, "/dev/fd/")) return false;
  std::error_code ignored;
  return fs::is_character_file(input, ignored);
}

// The frames of a camera. A picture that cannot be decoded looks as if the camera had gone, but further ones come
// behind it.
class Camera {
 public:
  Camera(std::string input, std::unique_ptr<cv::VideoCapture> capture)
      : input_(std::move(input)), capture_(std::move(capture)) {}

  bool Advance() {
    if (capture_->grab()) return true;
    const SystemClock clock;
    const SteadyTime failed = clock.SteadyNow();
    while (clock.Since(failed) < kPatience) {
      if (!capture_->grab()) continue;
      ++damages_;
      return true;
    }
    return false;
  }
  cv::Mat Picture() {
    cv::Mat picture;
    capture_->retrieve(picture);
    return picture.clone();  // the next one reuses the memory
  }
  std::string Doubt() const {
    return damages_ == 0 ? "" : absl::StrCat(input_, ": ", damages_, " damaged pictures were left out");
  }

 private:
  const std::string input_;
  const std::unique_ptr<cv::VideoCapture> capture_;
  int64_t damages_ = 0;
};

}  // namespace

FrameSource::FrameSource(std::string input, Reader reader, double fps, int64_t frames, bool live)
    : input_(std::move(input)),
      reader_(std::move(reader)),
      fps_(IsRate(fps) ? fps : kDefaultFps),
      fps_is_guess_(!IsRate(fps)),
      frames_(std::max<int64_t>(0, frames)),
      live_(live) {}

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
  auto opened = VideoFile::Open(input);
  if (!opened.ok()) return opened.status();
  const std::shared_ptr<VideoFile> file = *std::move(opened);
  Reader reader{[file] { return file->Advance(); },
                [input, file]() -> absl::StatusOr<cv::Mat> {
                  auto picture = WithoutException(input, [&] { return file->Picture(); });
                  return picture.ok() ? *std::move(picture) : picture.status();
                },
                [file] { return file->Doubt(); }};
  return std::unique_ptr<FrameSource>(
      new FrameSource(input, std::move(reader), file->fps(), file->frames(), file->live()));
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
      new FrameSource(input, {advance, retrieve, [] { return ""; }}, kDefaultFps, count, /*live=*/false));
}

absl::StatusOr<std::unique_ptr<FrameSource>> FrameSource::OpenCamera(const std::string& input) {
  absl::string_view text = input;
  int number = -1;
  if (absl::ConsumePrefix(&text, kCameraPrefix) && (!absl::SimpleAtoi(text, &number) || number < 0)) {
    return absl::InvalidArgumentError(absl::StrCat(input, ": expected camera:0, camera:1, ..."));
  }
  const std::string device = number < 0 ? input : absl::StrCat("/dev/video", number);
  auto capture = std::make_unique<cv::VideoCapture>();
  if (!capture->open(device, cv::CAP_V4L2))
    return absl::NotFoundError(absl::StrCat(input, ": no camera answers there"));
  const double fps = capture->get(cv::CAP_PROP_FPS);
  const auto opened = std::make_shared<Camera>(input, std::move(capture));
  Reader reader{[input, opened] { return WithoutException(input, [&] { return opened->Advance(); }); },
                [input, opened] { return WithoutException(input, [&] { return opened->Picture(); }); },
                [opened] { return opened->Doubt(); }};
  return std::unique_ptr<FrameSource>(new FrameSource(input, std::move(reader), fps, 0, /*live=*/true));
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
    // Whatever has a covered pixel under it is covered, so that nothing is too thin to be sent. Bytes would round a
    // small share of a pixel to none.
    mask.convertTo(mask, CV_32F);
    cv::resize(mask, mask, {sent_.width, sent_.height}, 0, 0, cv::INTER_AREA);
    mask = mask > 0;
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
