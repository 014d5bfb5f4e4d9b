// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/opencv_decoder.h"

#include <opencv2/imgcodecs.hpp>

#include "server/engine/input/png_check.h"

namespace holdfast {

absl::StatusOr<cv::Mat> DecodeWithOpenCv(absl::string_view bytes, ImageSize size, int flags) {
  char* data = const_cast<char*>(bytes.data());  // only read
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, data);
  cv::Mat image = cv::imdecode(encoded, flags | cv::IMREAD_IGNORE_ORIENTATION);
  if (image.cols != size.width || image.rows != size.height) {
    return absl::InvalidArgumentError("the picture is broken");
  }
  return image;
}

absl::StatusOr<cv::Mat> DecodePng(absl::string_view bytes, ImageSize size, int flags) {
  if (absl::Status status = CheckPngData(bytes); !status.ok()) return status;
  return DecodeWithOpenCv(PngWithoutMetadata(bytes), size, flags);
}

}  // namespace holdfast
