// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"

namespace holdfast {

// How many pixels of a JPEG, each way, one pixel may stand for so that no side is shorter than that of 'least': 8, 4, 2
// or 1. A side that leaves a remainder would end with a pixel that stands for fewer, and what is seen would lie beside
// where it is: it is not reduced.
int JpegReduction(ImageSize size, ImageSize least);

// The picture in 'bytes', BGR, at 1 / 'reduction' of its sides: a fraction of the work, and each pixel is the mean of
// those it stands for. Colours as libjpeg has them, damage within the coded data leaves a damaged picture.
// UNIMPLEMENTED: four colours, or a kind so rare that libturbojpeg does not name it. INVALID_ARGUMENT: broken. Throws
// std::bad_alloc, and what cv::Mat throws. REQUIRES: CheckJpeg said 'size' of the bytes, and 'reduction' divides it.
absl::StatusOr<cv::Mat> DecodeJpeg(absl::string_view bytes, ImageSize size, int reduction);

}  // namespace holdfast
