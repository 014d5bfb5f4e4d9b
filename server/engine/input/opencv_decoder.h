// SPDX-License-Identifier: Apache-2.0
// How pictures are read with OpenCV, be they frames or masks.
#pragma once

#include <new>
#include <opencv2/core.hpp>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "api/types.h"

namespace holdfast {

// The picture in 'bytes', read with OpenCV's 'flags' and in the orientation that it is stored in. INVALID_ARGUMENT: it
// is broken, or its size is not 'size'. Throws what OpenCV throws, see CatchOpenCv.
absl::StatusOr<cv::Mat> DecodeWithOpenCv(absl::string_view bytes, ImageSize size, int flags);

// The same for a PNG, of which nothing is inflated that is not the picture. REQUIRES: CheckPng is OK.
absl::StatusOr<cv::Mat> DecodePng(absl::string_view bytes, ImageSize size, int flags);

// What 'work' returns, a Status or StatusOr. What it throws becomes RESOURCE_EXHAUSTED, "no memory to <deed>", or
// 'broken' where OpenCV found something wrong.
template <typename Work>
auto CatchOpenCv(absl::string_view deed, const absl::Status& broken, Work work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
  } catch (const cv::Exception& e) {
    if (e.code != cv::Error::StsNoMem) return broken;
  }
  return absl::ResourceExhaustedError(absl::StrCat("no memory to ", deed));
}

}  // namespace holdfast
