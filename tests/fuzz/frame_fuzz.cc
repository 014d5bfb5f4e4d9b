// SPDX-License-Identifier: Apache-2.0
// A frame's way in: the check of its header and structure, then the decoder. The first byte chooses the encoding, the
// next two the sides of raw frames; the rest is the frame.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <string>

#include "server/engine/input/frame_decoder.h"
#include "tests/fuzz/fuzz_input.h"

namespace holdfast {
namespace {

constexpr ImageSize kProcessed{32, 32};
constexpr ImageSize kGray{40, 24};
constexpr int64_t kMaxPixels = int64_t{256} * 256;

void Decode(absl::string_view bytes, const FrameFormat& format) {
  const absl::StatusOr<ImageSize> size = FrameSize(bytes, format);
  if (!size.ok()) return;
  EXPECT_LE(Pixels(*size), kMaxPixels);
  GrayImage gray;
  gray.size = kGray;
  const absl::StatusOr<RgbImage> image = DecodeFrame(bytes, format, *size, kProcessed, &gray);
  if (!image.ok()) return;
  EXPECT_EQ(image->pixels.size(), 3 * Pixels(kProcessed));
  EXPECT_EQ(gray.pixels.size(), Pixels(kGray));
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using holdfast::FrameEncoding;
  constexpr FrameEncoding kEncodings[] = {FrameEncoding::kJpeg, FrameEncoding::kPng, FrameEncoding::kRgb24,
                                          FrameEncoding::kBgr24, FrameEncoding::kGray8};
  holdfast::FuzzInput input(data, size);
  holdfast::FrameFormat format;
  format.encoding = kEncodings[input.TakeByte() % 5];
  format.raw_size.width = input.TakeByte();
  format.raw_size.height = input.TakeByte();
  format.max_pixels = holdfast::kMaxPixels;
  holdfast::Decode(input.TakeRest(), format);
  return 0;
}
