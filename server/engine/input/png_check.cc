// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/png_check.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "api/limits.h"
#include "server/engine/input/big_endian.h"

namespace holdfast {
namespace {

constexpr absl::string_view kSignature("\x89PNG\r\n\x1A\n", 8);
constexpr size_t kHeaderBytes = 13;
constexpr int64_t kSpareBytes = int64_t{64} * 1024;  // some encoders append a little to the picture's data

struct Chunk {
  absl::string_view type, data;
  absl::string_view whole;  // with length and checksum
  // Chunks that the picture is made of have a capital first letter.
  bool critical() const { return (ByteAt(type, 0) & 0x20) == 0; }
};

// Takes the first chunk off 'rest'; none: there is no whole one.
std::optional<Chunk> TakeChunk(absl::string_view& rest) {
  constexpr size_t kFrame = 12;  // length, type, checksum
  if (rest.size() < kFrame) return std::nullopt;
  const size_t length = BigEndian32(rest, 0);
  if (length > rest.size() - kFrame) return std::nullopt;
  const Chunk chunk{rest.substr(4, 4), rest.substr(8, length), rest.substr(0, kFrame + length)};
  rest.remove_prefix(chunk.whole.size());
  return chunk;
}

struct Header {
  int64_t width = 0, height = 0;
  int bits = 0;  // of a pixel
  bool interlaced = false;
};

absl::StatusOr<Header> ParseHeader(absl::string_view data) {
  Header header{BigEndian32(data, 0), BigEndian32(data, 4)};
  const int depth = ByteAt(data, 8), colour = ByteAt(data, 9), interlace = ByteAt(data, 12);
  constexpr std::array<int, 7> kChannels = {1, 0, 3, 1, 2, 0, 4};
  if (header.width > INT32_MAX || header.height > INT32_MAX) return absl::InvalidArgumentError("no PNG header");
  if (colour > 6 || kChannels[colour] == 0) {
    return absl::InvalidArgumentError(absl::StrCat("PNG colour type ", colour, ", expected 0, 2, 3, 4 or 6"));
  }
  if (depth != 1 && depth != 2 && depth != 4 && depth != 8 && depth != 16) {
    return absl::InvalidArgumentError(absl::StrCat("PNG bit depth ", depth, ", expected 1, 2, 4, 8 or 16"));
  }
  if (interlace > 1)
    return absl::InvalidArgumentError(absl::StrCat("PNG interlacing ", interlace, ", expected 0 or 1"));
  header.bits = depth * kChannels[colour];
  header.interlaced = interlace == 1;
  return header;
}

int64_t DivideUp(int64_t value, int64_t by) { return (value + by - 1) / by; }

// Of rows and their filter bytes, before compression.
int64_t PassBytes(int64_t width, int64_t height, int bits) {
  return width == 0 ? 0 : height * (1 + DivideUp(width * bits, 8));
}

int64_t DataBytes(const Header& header) {
  if (!header.interlaced) return PassBytes(header.width, header.height, header.bits);
  struct Pass {
    int x, y, dx, dy;  // first pixel and steps
  };
  constexpr std::array<Pass, 7> kPasses = {
      {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4}, {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}}};
  int64_t bytes = 0;
  for (const Pass& pass : kPasses) {
    const int64_t width = DivideUp(std::max<int64_t>(header.width - pass.x, 0), pass.dx);
    const int64_t height = DivideUp(std::max<int64_t>(header.height - pass.y, 0), pass.dy);
    bytes += PassBytes(width, height, header.bits);
  }
  return bytes;
}

absl::StatusOr<Header> ReadHeader(absl::string_view bytes) {
  absl::string_view rest = bytes;
  if (!absl::ConsumePrefix(&rest, kSignature)) return absl::InvalidArgumentError("no PNG header");
  const std::optional<Chunk> chunk = TakeChunk(rest);
  if (!chunk || chunk->type != "IHDR" || chunk->data.size() != kHeaderBytes) {
    return absl::InvalidArgumentError("no PNG header");
  }
  return ParseHeader(chunk->data);
}

// False: more than 'limit' came out already.
bool InflateWithin(z_stream& stream, absl::string_view data, int64_t limit) {
  std::array<uint8_t, size_t{32} * 1024> scratch;
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data.data()));  // only read
  stream.avail_in = static_cast<uInt>(data.size());
  while (true) {
    stream.next_out = scratch.data();
    stream.avail_out = scratch.size();
    const int result = inflate(&stream, Z_NO_FLUSH);
    if (static_cast<int64_t>(stream.total_out) > limit) return false;
    // All taken, at its end, or broken, which the decoder finds too.
    if (result != Z_OK || stream.avail_out != 0) return true;
  }
}

}  // namespace

absl::StatusOr<ImageSize> CheckPng(absl::string_view bytes) {
  const absl::StatusOr<Header> header = ReadHeader(bytes);
  if (!header.ok()) return header.status();
  absl::string_view rest = bytes.substr(kSignature.size());
  int64_t metadata = 0;
  while (const std::optional<Chunk> chunk = TakeChunk(rest)) {
    if (chunk->type == "IEND") return ImageSize{static_cast<int>(header->width), static_cast<int>(header->height)};
    if (chunk->critical()) continue;
    metadata += static_cast<int64_t>(chunk->whole.size());
    if (metadata > kMaxMetadataBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat("PNG metadata bytes: ", metadata, ", at most ", kMaxMetadataBytes));
    }
  }
  return absl::InvalidArgumentError("truncated picture");
}

absl::Status CheckPngData(absl::string_view bytes) {
  const absl::StatusOr<Header> header = ReadHeader(bytes);
  if (!header.ok()) return header.status();
  const int64_t size = DataBytes(*header);
  z_stream stream = {};
  if (inflateInit(&stream) != Z_OK) return absl::ResourceExhaustedError("no memory to decode the frame");
  const auto end = absl::MakeCleanup([&stream] { inflateEnd(&stream); });
  absl::string_view rest = bytes.substr(kSignature.size());
  while (const std::optional<Chunk> chunk = TakeChunk(rest)) {
    if (chunk->type == "IEND") break;
    if (chunk->type == "IDAT" && !InflateWithin(stream, chunk->data, size + kSpareBytes)) {
      return absl::InvalidArgumentError(absl::StrCat("PNG data inflates to more than the picture's ", size, " bytes"));
    }
  }
  return absl::OkStatus();
}

std::string PngWithoutMetadata(absl::string_view bytes) {
  std::string picture(kSignature);
  picture.reserve(bytes.size());
  absl::string_view rest = bytes.substr(kSignature.size());
  while (const std::optional<Chunk> chunk = TakeChunk(rest)) {
    if (chunk->critical()) picture.append(chunk->whole.data(), chunk->whole.size());
    if (chunk->type == "IEND") break;
  }
  return picture;
}

}  // namespace holdfast
