// SPDX-License-Identifier: Apache-2.0
#include "server/engine/frame_decoder.h"

#include <new>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_cat.h"
#include "server/engine/image_header.h"

namespace holdfast {
namespace {

int64_t BytesPerPixel(FrameEncoding encoding) { return encoding == FrameEncoding::kGray8 ? 1 : 3; }

int64_t Pixels(ImageSize size) { return int64_t{size.width} * size.height; }

absl::StatusOr<ImageSize> HeaderSize(absl::string_view bytes, const FrameFormat& format) {
  switch (format.encoding) {
    case FrameEncoding::kJpeg:
      return JpegSize(bytes);
    case FrameEncoding::kPng:
      return PngSize(bytes);
    default:
      return format.raw_size;
  }
}

// A decoder fills what is missing with grey and says nothing: a picture that does not end is looked for here.
bool IsTruncated(absl::string_view bytes, FrameEncoding encoding) {
  const absl::string_view end = encoding == FrameEncoding::kJpeg ? "\xFF\xD9" : "IEND";
  const size_t start = encoding == FrameEncoding::kJpeg ? bytes.rfind("\xFF\xDA") : 0;  // a thumbnail has its own end
  return start == absl::string_view::npos || bytes.find(end, start) == absl::string_view::npos;
}

// The picture in the colours of the third argument of cvtColor; may look into 'bytes'.
absl::StatusOr<cv::Mat> Open(absl::string_view bytes, const FrameFormat& format, ImageSize size) {
  char* data = const_cast<char*>(bytes.data());  // only read
  if (IsRaw(format.encoding)) {
    return cv::Mat(size.height, size.width, format.encoding == FrameEncoding::kGray8 ? CV_8UC1 : CV_8UC3, data);
  }
  if (IsTruncated(bytes, format.encoding)) return absl::InvalidArgumentError("truncated picture");
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, data);
  cv::Mat image = cv::imdecode(encoded, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (image.cols != size.width || image.rows != size.height) {
    return absl::InvalidArgumentError("not a picture of the session's encoding, or broken");
  }
  return image;
}

void ToRgb(const cv::Mat& image, FrameEncoding encoding, cv::Mat& rgb) {
  switch (encoding) {
    case FrameEncoding::kRgb24:
      image.copyTo(rgb);
      return;
    case FrameEncoding::kGray8:
      cv::cvtColor(image, rgb, cv::COLOR_GRAY2RGB);
      return;
    default:
      cv::cvtColor(image, rgb, cv::COLOR_BGR2RGB);
  }
}

absl::StatusOr<RgbImage> Decode(absl::string_view bytes, const FrameFormat& format, ImageSize size, ImageSize target) {
  absl::StatusOr<cv::Mat> image = Open(bytes, format, size);
  if (!image.ok()) return image.status();
  cv::Mat small = *image;
  if (size != target) cv::resize(*image, small, {target.width, target.height}, 0, 0, cv::INTER_LINEAR);
  RgbImage result{target, std::vector<uint8_t>(Pixels(target) * 3)};
  cv::Mat rgb(target.height, target.width, CV_8UC3, result.pixels.data());
  ToRgb(small, format.encoding, rgb);
  return result;
}

}  // namespace

absl::StatusOr<ImageSize> FrameSize(absl::string_view bytes, const FrameFormat& format) {
  const absl::StatusOr<ImageSize> size = HeaderSize(bytes, format);
  if (!size.ok()) return size.status();
  if (size->width <= 0 || size->height <= 0) return absl::InvalidArgumentError("a picture without pixels");
  if (Pixels(*size) > format.max_pixels) {
    return absl::InvalidArgumentError(
        absl::StrCat(size->width, "x", size->height, " is more than ", format.max_pixels, " pixels"));
  }
  const int64_t wanted = Pixels(*size) * BytesPerPixel(format.encoding);
  if (IsRaw(format.encoding) && static_cast<int64_t>(bytes.size()) != wanted) {
    return absl::InvalidArgumentError(absl::StrCat(bytes.size(), " bytes, expected ", wanted));
  }
  return size;
}

absl::StatusOr<RgbImage> DecodeFrame(absl::string_view bytes, const FrameFormat& format, ImageSize processing_size) {
  const absl::StatusOr<ImageSize> size = FrameSize(bytes, format);
  if (!size.ok()) return size.status();
  try {
    return Decode(bytes, format, *size, processing_size);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("no memory to decode the frame");
  } catch (const cv::Exception& e) {
    if (e.code == cv::Error::StsNoMem) return absl::ResourceExhaustedError("no memory to decode the frame");
    return absl::InvalidArgumentError("the picture is broken");
  }
}

}  // namespace holdfast
