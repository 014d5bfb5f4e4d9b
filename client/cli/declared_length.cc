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

class Bytes {
 public:
  explicit Bytes(const std::string& path) : file_(path, std::ios::binary) {
    std::error_code error;
    const uintmax_t size = std::filesystem::file_size(path, error);
    size_ = error ? 0 : size;
  }
  uint64_t size() const { return size_; }
  bool Holds(uint64_t at, uint64_t count) const { return at <= size_ && count <= size_ - at; }
  // Fewer at the end of the file.
  std::string Read(uint64_t at, size_t count) {
    std::string bytes(count, '\0');
    file_.clear();
    file_.seekg(static_cast<std::streamoff>(at));
    file_.read(bytes.data(), static_cast<std::streamsize>(count));
    bytes.resize(static_cast<size_t>(file_.gcount()));
    return bytes;
  }

 private:
  std::ifstream file_;
  uint64_t size_ = 0;
};

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

// Boxes, each with its length, that of a large one behind its type; 0: up to the end of the file, wherever that is.
bool LacksEndOfMp4(Bytes& file) {
  for (uint64_t at = 0; file.Holds(at, 8);) {
    const std::string head = file.Read(at, 16);
    const bool large = BigEndian(head.substr(0, 4)) == 1;
    const uint64_t length = BigEndian(large ? head.substr(8) : head.substr(0, 4));
    if (length < 8) return false;
    const std::string type = head.substr(4, 4);
    // Other boxes hold nothing that is missed, and what some cameras append is no box at all.
    if (!file.Holds(at, length)) return type == "mdat" || type == "moov" || type == "moof";
    at += length;
  }
  return false;
}

// A chunk, and further ones in files beyond a gigabyte.
bool LacksEndOfAvi(Bytes& file) {
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
std::optional<Element> FindElement(Bytes& file, uint64_t at, absl::string_view id) {
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

bool LacksEndOfMatroska(Bytes& file) {
  const auto header = FindElement(file, 0, kEbml);
  if (!header || !file.Holds(header->begin, header->length)) return false;
  const auto segment = FindElement(file, header->begin + header->length, kSegment);
  return segment && !file.Holds(segment->begin, segment->length);
}

}  // namespace

bool LacksItsEnd(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return false;
  Bytes file(path);
  const std::string head = file.Read(0, 12);
  if (absl::StartsWith(head, kEbml)) return LacksEndOfMatroska(file);
  if (absl::StartsWith(head, "RIFF")) return LacksEndOfAvi(file);
  for (const char* type : {"ftyp", "moov", "mdat", "wide"}) {  // what MP4 or QuickTime begins with
    if (head.size() == 12 && head.substr(4, 4) == type) return LacksEndOfMp4(file);
  }
  return false;
}

}  // namespace holdfast
