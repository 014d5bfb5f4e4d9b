// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/frame_decoder.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_cat.h"
#include "server/engine/input/jpeg_check.h"
#include "server/engine/input/jpeg_decoder.h"
#include "server/engine/input/opencv_decoder.h"
#include "server/engine/input/png_check.h"

namespace holdfast {
namespace {

absl::StatusOr<ImageSize> EncodedSize(absl::string_view bytes, const FrameFormat& format) {
  switch (format.encoding) {
    case FrameEncoding::kJpeg:
      return CheckJpeg(bytes);
    case FrameEncoding::kPng:
      return CheckPng(bytes);
    default:
      return format.raw_size;
  }
}

// Flow, which finds places to a fraction of a pixel, does so less well in a picture that was made smaller twice: on
// annotated video it loses nothing where the first one has half as many pixels again each way. The network does not
// mind.
constexpr double kSpareForFlow = 1.5;

// As small as leaves enough pixels to the network and to flow. Whether flow looks at all plays no part, so that the
// network sees the same either way.
absl::StatusOr<cv::Mat> OpenJpeg(absl::string_view bytes, ImageSize size, ImageSize target) {
  const ImageSize flow = FlowSize(size, target);
  const auto least_side = [](int processed, int seen) {
    return std::max(processed, static_cast<int>(std::ceil(kSpareForFlow * seen)));
  };
  const ImageSize least{least_side(target.width, flow.width), least_side(target.height, flow.height)};
  absl::StatusOr<cv::Mat> image = DecodeJpeg(bytes, size, JpegReduction(size, least));
  return absl::IsUnimplemented(image.status()) ? DecodeWithOpenCv(bytes, size, cv::IMREAD_COLOR) : image;
}

// The picture, perhaps at a smaller size, in the colours of the third argument of cvtColor; may look into 'bytes'.
absl::StatusOr<cv::Mat> Open(absl::string_view bytes, const FrameFormat& format, ImageSize size, ImageSize target) {
  if (IsRaw(format.encoding)) {
    char* data = const_cast<char*>(bytes.data());  // only read
    return cv::Mat(size.height, size.width, format.encoding == FrameEncoding::kGray8 ? CV_8UC1 : CV_8UC3, data);
  }
  if (format.encoding == FrameEncoding::kJpeg) return OpenJpeg(bytes, size, target);
  return DecodePng(bytes, size, cv::IMREAD_COLOR);
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

void ToGray(const cv::Mat& image, FrameEncoding encoding, GrayImage& gray) {
  cv::Mat full = image;
  if (image.channels() == 3) {
    cv::cvtColor(image, full, encoding == FrameEncoding::kRgb24 ? cv::COLOR_RGB2GRAY : cv::COLOR_BGR2GRAY);
  }
  gray.pixels.resize(Pixels(gray.size));
  cv::Mat out(gray.size.height, gray.size.width, CV_8UC1, gray.pixels.data());
  if (full.size() == out.size()) {
    full.copyTo(out);
  } else {
    const bool smaller = full.cols >= out.cols && full.rows >= out.rows;
    cv::resize(full, out, out.size(), 0, 0, smaller ? cv::INTER_AREA : cv::INTER_LINEAR);
  }
}

absl::StatusOr<RgbImage> Decode(absl::string_view bytes, const FrameFormat& format, ImageSize size, ImageSize target,
                                GrayImage* gray) {
  absl::StatusOr<cv::Mat> image = Open(bytes, format, size, target);
  if (!image.ok()) return image.status();
  if (gray != nullptr) ToGray(*image, format.encoding, *gray);
  cv::Mat small = *image;
  const cv::Size wanted(target.width, target.height);
  if (small.size() != wanted) cv::resize(*image, small, wanted, 0, 0, cv::INTER_LINEAR);
  RgbImage result{target, std::vector<uint8_t>(Pixels(target) * 3)};
  cv::Mat rgb(target.height, target.width, CV_8UC3, result.pixels.data());
  ToRgb(small, format.encoding, rgb);
  return result;
}

}  // namespace

int64_t RawBytes(FrameEncoding encoding, ImageSize size) {
  return Pixels(size) * (encoding == FrameEncoding::kGray8 ? 1 : 3);
}

absl::StatusOr<ImageSize> FrameSize(absl::string_view bytes, const FrameFormat& format) {
  const absl::StatusOr<ImageSize> size = EncodedSize(bytes, format);
  if (!size.ok()) return size.status();
  if (size->width <= 0 || size->height <= 0) return absl::InvalidArgumentError("a picture without pixels");
  if (Pixels(*size) > format.max_pixels) {
    return absl::InvalidArgumentError(absl::StrCat(ToString(*size), " is more than ", format.max_pixels, " pixels"));
  }
  const int64_t wanted = RawBytes(format.encoding, *size);
  if (IsRaw(format.encoding) && static_cast<int64_t>(bytes.size()) != wanted) {
    return absl::InvalidArgumentError(absl::StrCat(bytes.size(), " bytes, expected ", wanted));
  }
  return size;
}

absl::StatusOr<RgbImage> DecodeFrame(absl::string_view bytes, const FrameFormat& format, ImageSize size,
                                     ImageSize processing_size, GrayImage* gray) {
  return CatchOpenCv("decode the frame", absl::InvalidArgumentError("the picture is broken"),
                     [&] { return Decode(bytes, format, size, processing_size, gray); });
}

}  // namespace holdfast
