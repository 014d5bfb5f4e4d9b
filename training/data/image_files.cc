// SPDX-License-Identifier: Apache-2.0
#include "training/data/image_files.h"

#include <png.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

constexpr int64_t kMaxMaskPixels = int64_t{1} << 28;
constexpr int kMedianReach = 3;  // pixels to each side

std::string ReadBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// False for a JPEG that was cut: the decoder fills with grey what is missing, and only warns. Segments are stepped
// over, as a thumbnail in one has an end of its own; coded data has a zero or the number of a restart behind each of
// its 0xFF.
bool IsWhole(absl::string_view bytes) {
  if (!absl::StartsWith(bytes, "\xFF\xD8")) return true;  // of another format, whose decoder fails
  const auto byte = [&](size_t at) { return at < bytes.size() ? static_cast<uchar>(bytes[at]) : 0; };
  for (size_t at = 2; (at = bytes.find('\xFF', at)) != absl::string_view::npos;) {
    const int marker = byte(at + 1);
    if (marker == 0xD9) return true;
    const bool bare = marker <= 1 || (marker >= 0xD0 && marker <= 0xD7);
    at += marker == 0xFF ? 1 : bare ? 2 : 2 + static_cast<size_t>(byte(at + 2) << 8 | byte(at + 3));
  }
  return false;
}

absl::StatusOr<cv::Mat> ReadImage(const std::string& path, int flags) {
  if (!Exists(path)) return absl::NotFoundError(absl::StrCat("no file ", path));
  const std::string bytes = ReadBytes(path);
  if (!IsWhole(bytes)) return absl::DataLossError(absl::StrCat("the picture ", path, " is cut short"));
  try {
    cv::Mat image = cv::imdecode(std::vector<uchar>(bytes.begin(), bytes.end()), flags);
    if (!image.empty()) return image;
  } catch (const cv::Exception&) {
    // As below: a picture the codec refuses.
  }
  return absl::DataLossError(absl::StrCat("cannot read the picture ", path));
}

absl::Status WriteImage(const std::string& path, const cv::Mat& image, int jpeg_quality) {
  try {
    if (cv::imwrite(path, image, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality})) return absl::OkStatus();
  } catch (const cv::Exception&) {
    // As below.
  }
  return absl::UnavailableError(absl::StrCat("cannot write ", path));
}

absl::Status SizeDiffers(const std::string& path) {
  return absl::DataLossError(absl::StrCat(path, " differs in size from the pictures before it"));
}

// Whether a PNG's pixels are places in a palette, which is of no more meaning where they are ids.
bool HasPalette(const std::string& path) {
  constexpr size_t kColourType = 25;  // behind the signature, in the header that comes first
  constexpr char kPalette = 3;
  char head[kColourType + 1] = {};
  std::ifstream file(path, std::ios::binary);
  return file.read(head, sizeof(head)) && absl::string_view(head, 8) == "\x89PNG\r\n\x1a\n" &&
         head[kColourType] == kPalette;
}

// [H, W] CV_8UC1, the places in the palette; OpenCV would give the colours that stand there.
absl::StatusOr<cv::Mat> ReadPaletteIndices(const std::string& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  const auto unreadable = [&] {
    png_image_free(&image);
    return absl::DataLossError(absl::StrCat("cannot read the picture ", path));
  };
  if (png_image_begin_read_from_file(&image, path.c_str()) == 0) return unreadable();
  if (int64_t{image.width} * image.height > kMaxMaskPixels) return unreadable();
  image.format = PNG_FORMAT_RGBA_COLORMAP;  // with a palette of its own a picture keeps its indices
  cv::Mat indices(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1);
  std::array<png_byte, PNG_IMAGE_SAMPLE_SIZE(PNG_FORMAT_RGBA) * 256> palette;
  if (png_image_finish_read(&image, nullptr, indices.data, image.width, palette.data()) == 0) return unreadable();
  return indices;
}

// One id for each colour: black is 0.
cv::Mat IdsOfColours(const cv::Mat& image) {
  cv::Mat ids(image.size(), CV_32SC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const uchar* const pixel = image.ptr<uchar>(y) + static_cast<ptrdiff_t>(x) * image.channels();
      ids.at<int32_t>(y, x) = pixel[0] | pixel[1] << 8 | pixel[2] << 16;
    }
  }
  return ids;
}

// Median of the 7 x 7 pixels about (x, y).
int32_t MedianAround(const cv::Mat& mask, int x, int y) {
  constexpr size_t kSide = 2 * kMedianReach + 1;
  std::array<int32_t, kSide * kSide> labels{};
  auto end = labels.begin();
  for (int j = std::max(y - kMedianReach, 0); j <= std::min(y + kMedianReach, mask.rows - 1); ++j) {
    for (int i = std::max(x - kMedianReach, 0); i <= std::min(x + kMedianReach, mask.cols - 1); ++i) {
      *end++ = mask.at<int32_t>(j, i);
    }
  }
  const auto middle = labels.begin() + (end - labels.begin()) / 2;
  std::nth_element(labels.begin(), middle, end);
  return *middle;
}

}  // namespace

bool Exists(const std::filesystem::path& path) {
  std::error_code unknown;
  return std::filesystem::exists(path, unknown);
}

absl::StatusOr<cv::Mat> ReadFrame(const std::string& path) {
  absl::StatusOr<cv::Mat> image = ReadImage(path, cv::IMREAD_COLOR);
  if (image.ok()) cv::cvtColor(*image, *image, cv::COLOR_BGR2RGB);
  return image;
}

absl::StatusOr<cv::Mat> ReadMask(const std::string& path) {
  absl::StatusOr<cv::Mat> image = HasPalette(path) ? ReadPaletteIndices(path) : ReadImage(path, cv::IMREAD_UNCHANGED);
  if (!image.ok()) return image;
  if (image->channels() >= 3 && image->depth() == CV_8U) return IdsOfColours(*image);
  if (image->channels() != 1 || (image->depth() != CV_8U && image->depth() != CV_16U)) {
    return absl::DataLossError(absl::StrCat(path, " is not a mask: expected one channel of 8 or 16 bits, or colours"));
  }
  cv::Mat ids;
  image->convertTo(ids, CV_32S);
  return ids;
}

absl::Status WriteFrame(const std::string& path, const cv::Mat& frame, int jpeg_quality) {
  cv::Mat bgr;
  cv::cvtColor(frame, bgr, cv::COLOR_RGB2BGR);
  return WriteImage(path, bgr, jpeg_quality);
}

absl::Status WriteMask(const std::string& path, const cv::Mat& mask) {
  cv::Mat ids;
  mask.convertTo(ids, CV_16U);
  return WriteImage(path, ids, 0);
}

absl::Status ReadFrames(const std::vector<std::string>& paths, ImageSize size, Sample& sample) {
  sample.frames.clear();
  cv::Size first;
  for (const std::string& path : paths) {
    absl::StatusOr<cv::Mat> frame = ReadFrame(path);
    if (!frame.ok()) return frame.status();
    if (sample.frames.empty()) first = frame->size();
    if (frame->size() != first) return SizeDiffers(path);
    if (!size.empty()) {
      const bool shrinks = size.width < first.width;
      cv::resize(*frame, *frame, {size.width, size.height}, 0, 0, shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
    }
    sample.frames.push_back(*std::move(frame));
  }
  return absl::OkStatus();
}

absl::Status ReadMasks(const std::vector<std::string>& paths, Sample& sample) {
  sample.masks.clear();
  for (const std::string& path : paths) {
    absl::StatusOr<cv::Mat> mask = ReadMask(path);
    if (!mask.ok()) return mask.status();
    if (!sample.frames.empty() && mask->size() != sample.frames[0].size()) return SizeDiffers(path);
    sample.masks.push_back(*std::move(mask));
  }
  return absl::OkStatus();
}

void FillHoles(int min_pixels, cv::Mat& mask) {
  constexpr int kSide = 2 * kMedianReach + 1;
  const cv::Mat unlabelled = mask == 0;
  cv::Mat near, holes, statistics, centres;
  cv::dilate(mask != 0, near, cv::getStructuringElement(cv::MORPH_RECT, {kSide, kSide}));
  cv::connectedComponentsWithStats(unlabelled, holes, statistics, centres, 8, CV_32S);
  cv::Mat filled = mask.clone();
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int hole = holes.at<int32_t>(y, x);
      if (hole == 0 || near.at<uchar>(y, x) == 0) continue;
      if (statistics.at<int32_t>(hole, cv::CC_STAT_AREA) <= min_pixels) continue;
      filled.at<int32_t>(y, x) = MedianAround(mask, x, y);
    }
  }
  mask = std::move(filled);
}

void ScaleTracks(ImageSize from, Sample& sample) {
  const double sx = static_cast<double>(sample.size().width) / from.width;
  const double sy = static_cast<double>(sample.size().height) / from.height;
  for (size_t i = 0; i + 1 < sample.tracks.size(); i += 2) {
    sample.tracks[i] = static_cast<float>(sample.tracks[i] * sx);
    sample.tracks[i + 1] = static_cast<float>(sample.tracks[i + 1] * sy);
  }
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      if (!sample.Inside(sample.Position(s, n))) sample.visible[sample.At(s, n)] = 0;
    }
  }
}

}  // namespace holdfast
