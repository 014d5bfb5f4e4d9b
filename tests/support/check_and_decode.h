// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/engine/input/frame_decoder.h"

namespace holdfast {

// Both steps of a frame's way in: the check when it comes, and decoding.
inline absl::StatusOr<RgbImage> CheckAndDecode(absl::string_view bytes, const FrameFormat& format,
                                               ImageSize processing_size, GrayImage* gray = nullptr) {
  const absl::StatusOr<ImageSize> size = FrameSize(bytes, format);
  if (!size.ok()) return size.status();
  return DecodeFrame(bytes, format, *size, processing_size, gray);
}

}  // namespace holdfast
