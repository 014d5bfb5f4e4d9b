// SPDX-License-Identifier: Apache-2.0
#include "client/cli/declared_length.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

constexpr absl::string_view kEbml = "\x1A\x45\xDF\xA3", kSegment = "\x18\x53\x80\x67";  // of Matroska

// A video file as bytes, for what its container says and FFmpeg does not tell. What is no file, or cannot be read, is
// empty.
class ContainerFile {
 public:
  explicit ContainerFile(const std::string& path);

  bool Holds(uint64_t at, uint64_t count) const { return at <= size_ && count <= size_ - at; }
  // Fewer at the end of the file.
  std::string Read(uint64_t at, size_t count);

 private:
  std::ifstream file_;
  uint64_t size_ = 0;
};

ContainerFile::ContainerFile(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return;  // a pipe is read once
  file_.open(path, std::ios::binary);
  const uintmax_t size = std::filesystem::file_size(path, error);
  size_ = error ? 0 : size;
}

std::string ContainerFile::Read(uint64_t at, size_t count) {
  std::string bytes(count, '\0');
  file_.clear();
  file_.seekg(static_cast<std::streamoff>(at));
  file_.read(bytes.data(), static_cast<std::streamsize>(count));
  bytes.resize(static_cast<size_t>(file_.gcount()));
  return bytes;
}

uint64_t BigEndian(absl::string_view bytes) {
  uint64_t value = 0;
  for (const char byte : bytes) value = value << 8 | static_cast<uint8_t>(byte);
  return value;
}

uint64_t LittleEndian(absl::string_view bytes) {
  uint64_t value = 0;
  for (size_t i = bytes.size(); i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes[i]);
  return value;
}

// Of what MP4 and QuickTime files consist.
struct Mp4Box {
  std::string type;      // four letters
  uint64_t content = 0;  // where it begins
  uint64_t length = 0;   // of that; the file may end before
};

// Whether the file begins as an MP4 or QuickTime one does.
bool IsMp4(ContainerFile& file) {
  const std::string head = file.Read(0, 12);
  for (const char* type : {"ftyp", "moov", "mdat", "wide"}) {
    if (head.size() == 12 && head.substr(4, 4) == type) return true;
  }
  return false;
}

// The box at 'at'; none where there is none, and for a last one that reaches to the end of the file, wherever that is.
// Its length comes first, that of a large one behind its type. Both count themselves.
std::optional<Mp4Box> Mp4BoxAt(ContainerFile& file, uint64_t at) {
  if (!file.Holds(at, 8)) return {};
  const std::string head = file.Read(at, 16);
  const bool large = BigEndian(head.substr(0, 4)) == 1;
  const uint64_t header = large ? 16 : 8;
  const uint64_t length = BigEndian(large ? head.substr(8) : head.substr(0, 4));
  if (head.size() < header || length < header) return {};
  return Mp4Box{head.substr(4, 4), at + header, length - header};
}

bool LacksEndOfMp4(ContainerFile& file) {
  for (uint64_t at = 0; file.Holds(at, 1);) {
    const auto box = Mp4BoxAt(file, at);
    if (!box) return false;
    // Other boxes hold nothing that is missed, and what some cameras append is no box at all.
    if (!file.Holds(box->content, box->length)) {
      return box->type == "mdat" || box->type == "moov" || box->type == "moof";
    }
    at = box->content + box->length;
  }
  return false;
}

// A chunk, and further ones in files beyond a gigabyte.
bool LacksEndOfAvi(ContainerFile& file) {
  for (uint64_t at = 0; file.Holds(at, 8);) {
    const std::string head = file.Read(at, 8);
    if (!absl::StartsWith(head, "RIFF")) return false;
    const uint64_t length = LittleEndian(head.substr(4));
    if (!file.Holds(at + 8, length)) return true;
    at += 8 + length + length % 2;
  }
  return false;
}

struct Element {
  uint64_t begin = 0;   // of what the element holds
  uint64_t length = 0;  // of that
};

// Of the Matroska element 'id' at 'at'. The length's first byte has as many zeros in front as there are bytes behind
// it; all ones mean that it is not known. None where it is not, or where there is another element.
std::optional<Element> FindElement(ContainerFile& file, uint64_t at, absl::string_view id) {
  const std::string head = file.Read(at, id.size() + 8);
  if (!absl::StartsWith(head, id) || head.size() == id.size()) return {};
  const auto first = static_cast<uint8_t>(head[id.size()]);
  size_t width = 1;
  while (width <= 8 && (first & 0x80 >> (width - 1)) == 0) ++width;
  if (width > 8 || head.size() < id.size() + width) return {};
  const uint64_t unknown = (uint64_t{1} << 7 * width) - 1;
  const uint64_t length = BigEndian(head.substr(id.size(), width)) & unknown;
  if (length == unknown) return {};
  return Element{at + id.size() + width, length};
}

bool LacksEndOfMatroska(ContainerFile& file) {
  const auto header = FindElement(file, 0, kEbml);
  if (!header || !file.Holds(header->begin, header->length)) return false;
  const auto segment = FindElement(file, header->begin + header->length, kSegment);
  return segment && !file.Holds(segment->begin, segment->length);
}

}  // namespace

bool LacksItsEnd(const std::string& path) {
  ContainerFile file(path);
  const std::string head = file.Read(0, kEbml.size());
  if (absl::StartsWith(head, kEbml)) return LacksEndOfMatroska(file);
  if (absl::StartsWith(head, "RIFF")) return LacksEndOfAvi(file);
  return IsMp4(file) && LacksEndOfMp4(file);
}

}  // namespace holdfast
