// SPDX-License-Identifier: Apache-2.0
#include "client/cli/container_file.h"

#include <filesystem>
#include <system_error>

namespace holdfast {

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

bool IsMp4(ContainerFile& file) {
  const std::string head = file.Read(0, 12);
  for (const char* type : {"ftyp", "moov", "mdat", "wide"}) {
    if (head.size() == 12 && head.substr(4, 4) == type) return true;
  }
  return false;
}

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

}  // namespace holdfast
