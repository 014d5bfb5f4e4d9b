// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

struct FrameFormat {
  FrameEncoding encoding = FrameEncoding::kJpeg;
  ImageSize raw_size;      // for raw encodings
  int64_t max_pixels = 0;  // width x height of a frame
};

// Of a frame of a raw encoding.
int64_t RawBytes(FrameEncoding encoding, ImageSize size);

// The size of the picture in 'bytes', from its header or (raw) from the format, at no cost in memory and in time that
// grows with the bytes alone: milliseconds for 16 MiB. INVALID_ARGUMENT: no such header, no pixels, too many, raw bytes
// of another size, or a structure that would make a decoder work for longer than a picture takes (see jpeg_check.h and
// png_check.h).
absl::StatusOr<ImageSize> FrameSize(absl::string_view bytes, const FrameFormat& format);

// Decodes to RGB, 8 bits a channel, in the orientation it is stored in, and resizes bilinearly to 'processing_size'. A
// large JPEG is decoded at a half, a quarter or an eighth of its sides, where these are whole and leave enough pixels.
// INVALID_ARGUMENT: broken or truncated bytes. Safe to call from several threads. REQUIRES: FrameSize said 'size' of
// the bytes. 'gray' may be null; otherwise it gets the same picture in grey at the size it has, each
// pixel the mean of those it covers.
absl::StatusOr<RgbImage> DecodeFrame(absl::string_view bytes, const FrameFormat& format, ImageSize size,
                                     ImageSize processing_size, GrayImage* gray = nullptr);

}  // namespace holdfast
