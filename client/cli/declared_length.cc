// SPDX-License-Identifier: Apache-2.0
#include "client/cli/declared_length.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"
#include "client/cli/container_file.h"

namespace holdfast {
namespace {

constexpr absl::string_view kEbml = "\x1A\x45\xDF\xA3", kSegment = "\x18\x53\x80\x67";  // of Matroska

uint64_t LittleEndian(absl::string_view bytes) {
  uint64_t value = 0;
  for (size_t i = bytes.size(); i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes[i]);
  return value;
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
