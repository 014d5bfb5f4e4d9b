// SPDX-License-Identifier: Apache-2.0
#include "server/engine/image_header.h"

#include <cstdint>

#include "absl/status/status.h"
#include "absl/strings/match.h"

namespace holdfast {
namespace {

uint8_t ByteAt(absl::string_view bytes, size_t at) { return static_cast<uint8_t>(bytes[at]); }

uint32_t BigEndian16(absl::string_view bytes, size_t at) { return ByteAt(bytes, at) << 8 | ByteAt(bytes, at + 1); }

uint32_t BigEndian32(absl::string_view bytes, size_t at) {
  return BigEndian16(bytes, at) << 16 | BigEndian16(bytes, at + 2);
}

// Start of frame: 0xC0 .. 0xCF but for the tables (DHT, DAC) and the reserved one among them.
bool IsStartOfFrame(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

// Markers that stand alone, without a segment after them.
bool IsBare(uint8_t marker) { return marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8); }

absl::Status NoJpeg() { return absl::InvalidArgumentError("no JPEG header"); }

}  // namespace

absl::StatusOr<ImageSize> JpegSize(absl::string_view bytes) {
  if (!absl::StartsWith(bytes, "\xFF\xD8\xFF")) return NoJpeg();
  size_t at = 2;
  while (true) {
    // As decoders do: whatever stands before a marker is skipped, and so are fill bytes.
    at = bytes.find('\xFF', at);
    if (at == absl::string_view::npos) return NoJpeg();
    at = bytes.find_first_not_of('\xFF', at);
    if (at == absl::string_view::npos) return NoJpeg();
    const uint8_t marker = ByteAt(bytes, at++);
    if (marker == 0 || IsBare(marker)) continue;
    if (marker == 0xD9 || marker == 0xDA || bytes.size() - at < 2) return NoJpeg();  // data before any frame header
    const size_t length = BigEndian16(bytes, at);
    if (length < 2 || bytes.size() - at < length) return NoJpeg();
    if (IsStartOfFrame(marker)) {
      if (length < 8) return NoJpeg();
      return ImageSize{static_cast<int>(BigEndian16(bytes, at + 5)), static_cast<int>(BigEndian16(bytes, at + 3))};
    }
    at += length;
  }
}

absl::StatusOr<ImageSize> PngSize(absl::string_view bytes) {
  constexpr absl::string_view kStart("\x89PNG\r\n\x1A\n\0\0\0\rIHDR", 16);
  if (bytes.size() < kStart.size() + 13 || !absl::StartsWith(bytes, kStart)) {
    return absl::InvalidArgumentError("no PNG header");
  }
  const uint32_t width = BigEndian32(bytes, 16), height = BigEndian32(bytes, 20);
  if (width > INT32_MAX || height > INT32_MAX) return absl::InvalidArgumentError("no PNG header");
  return ImageSize{static_cast<int>(width), static_cast<int>(height)};
}

}  // namespace holdfast
