// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/jpeg_check.h"

#include <cstdint>
#include <optional>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "api/limits.h"
#include "server/engine/input/big_endian.h"

namespace holdfast {
namespace {

// A decoder visits every block in every scan. libjpeg's script for progressive pictures has 10 scans for YCbCr and 18
// for CMYK, encoders that search for the smallest file end up below 20.
constexpr int kMaxScans = 32;
// Colour profiles have up to 255 segments, extended XMP one for every 64 kB; a scan brings a table or two.
constexpr int kMaxSegments = 1024;

constexpr uint8_t kSoi = 0xD8, kEoi = 0xD9, kSos = 0xDA, kDac = 0xCC, kCom = 0xFE;

// Start of frame: 0xC0 .. 0xCF but for the tables (DHT, DAC) and the reserved one among them.
bool IsStartOfFrame(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != kDac;
}

bool IsMetadata(uint8_t marker) { return marker == kCom || (marker >= 0xE0 && marker <= 0xEF); }

// Restart markers, and those that decoders skip on their way to one: no segment follows, which must not be a place to
// hide a scan in.
bool IsBare(uint8_t marker) { return marker < 0xC0 || (marker >= 0xD0 && marker <= 0xD7); }

absl::Status Bad(absl::string_view what, int64_t value, absl::string_view expected) {
  return absl::InvalidArgumentError(absl::StrCat("JPEG ", what, " ", value, ", ", expected));
}

absl::Status Truncated() { return absl::InvalidArgumentError("truncated picture"); }

class Walk {
 public:
  explicit Walk(absl::string_view bytes) : bytes_(bytes) {}

  absl::StatusOr<ImageSize> Run() {
    if (!absl::StartsWith(bytes_, "\xFF\xD8\xFF")) return absl::InvalidArgumentError("no JPEG header");
    at_ = 2;
    while (std::optional<uint8_t> marker = NextMarker()) {
      if (*marker == kEoi) return AtEnd();
      if (*marker == kSoi) return absl::InvalidArgumentError("a JPEG within the JPEG, expected one picture");
      if (absl::Status status = Segment(*marker); !status.ok()) return status;
    }
    return Truncated();
  }

 private:
  // As decoders do: whatever stands before a marker is skipped, and so are fill bytes. Coded data has a zero behind
  // each of its 0xFF and restart markers between its parts, so this leads to the end of a scan too.
  std::optional<uint8_t> NextMarker() {
    while ((at_ = bytes_.find('\xFF', at_)) != absl::string_view::npos) {
      // Byte by byte while they are dense: a search costs a call.
      for (; at_ + 1 < bytes_.size() && bytes_[at_] == '\xFF'; ++at_) {
        const uint8_t marker = ByteAt(bytes_, at_ + 1);
        if (marker == 0xFF) continue;
        ++at_;
        if (IsBare(marker)) continue;
        ++at_;
        return marker;
      }
      if (at_ + 1 >= bytes_.size()) break;
    }
    return std::nullopt;
  }

  absl::Status Segment(uint8_t marker) {
    if (bytes_.size() - at_ < 2) return Truncated();
    const size_t length = BigEndian16(bytes_, at_);
    if (length < 2) return Bad("segment of length", static_cast<int64_t>(length), "at least 2");
    if (bytes_.size() - at_ < length) return Truncated();
    const absl::string_view data = bytes_.substr(at_ + 2, length - 2);
    at_ += length;
    if (++segments_ > kMaxSegments) return Bad("segments:", segments_, absl::StrCat("at most ", kMaxSegments));
    if (marker == kSos) return Scan();
    if (IsStartOfFrame(marker)) return FrameHeader(marker, data);
    if (marker == kDac) return absl::InvalidArgumentError("JPEG with arithmetic coding, expected Huffman codes");
    if (!IsMetadata(marker)) return absl::OkStatus();
    metadata_ += static_cast<int64_t>(length) + 2;
    if (metadata_ <= kMaxMetadataBytes) return absl::OkStatus();
    return Bad("metadata bytes:", metadata_, absl::StrCat("at most ", kMaxMetadataBytes));
  }

  absl::Status FrameHeader(uint8_t marker, absl::string_view data) {
    if (size_) return absl::InvalidArgumentError("JPEG with two frame headers, expected one picture");
    if (data.size() < 6) return absl::InvalidArgumentError("no JPEG header");
    if (marker > 0xC2) return Bad("process", marker - 0xC0, "expected 0, 1 or 2 (baseline, extended or progressive)");
    if (ByteAt(data, 0) != 8) return Bad("bits a sample:", ByteAt(data, 0), "expected 8");
    const int components = ByteAt(data, 5);
    if (components != 1 && components != 3 && components != 4)
      return Bad("components:", components, "expected 1, 3, 4");
    size_ = ImageSize{static_cast<int>(BigEndian16(data, 3)), static_cast<int>(BigEndian16(data, 1))};
    return absl::OkStatus();
  }

  absl::Status Scan() {
    if (!size_) return absl::InvalidArgumentError("no JPEG header");  // data before any frame header
    if (++scans_ > kMaxScans) return Bad("scans:", scans_, absl::StrCat("at most ", kMaxScans));
    return absl::OkStatus();
  }

  absl::StatusOr<ImageSize> AtEnd() const {
    if (scans_ == 0) return Truncated();
    return *size_;
  }

  const absl::string_view bytes_;
  size_t at_ = 0;
  int segments_ = 0;
  int scans_ = 0;
  int64_t metadata_ = 0;
  std::optional<ImageSize> size_;
};

}  // namespace

absl::StatusOr<ImageSize> CheckJpeg(absl::string_view bytes) { return Walk(bytes).Run(); }

}  // namespace holdfast
