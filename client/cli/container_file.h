// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

// A video file as bytes, for what its container says and FFmpeg does not tell. What is no file, or cannot be read, is
// empty.
class ContainerFile {
 public:
  explicit ContainerFile(const std::string& path);

  uint64_t size() const { return size_; }
  bool Holds(uint64_t at, uint64_t count) const { return at <= size_ && count <= size_ - at; }
  // Fewer at the end of the file.
  std::string Read(uint64_t at, size_t count);

 private:
  std::ifstream file_;
  uint64_t size_ = 0;
};

uint64_t BigEndian(absl::string_view bytes);

// Of what MP4 and QuickTime files consist.
struct Mp4Box {
  std::string type;      // four letters
  uint64_t content = 0;  // where it begins
  uint64_t length = 0;   // of that; the file may end before
};

// Whether the file begins as an MP4 or QuickTime one does.
bool IsMp4(ContainerFile& file);
// The box at 'at'; none where there is none, and for a last one that reaches to the end of the file, wherever that is.
std::optional<Mp4Box> Mp4BoxAt(ContainerFile& file, uint64_t at);

}  // namespace holdfast
