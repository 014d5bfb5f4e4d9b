// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zlib.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace holdfast {

// The bytes of a zip file whose entries (name, content) are stored as they are, with the right checksums.
inline std::string StoredZip(const std::vector<std::pair<std::string, std::string>>& entries) {
  const auto number = [](uint64_t value, int bytes) {
    std::string out;
    for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i) & 0xFF);
    return out;
  };
  const std::string version = number(20, 2);
  const auto zeros = [](size_t bytes) { return std::string(bytes, '\0'); };
  std::string locals, directory;
  for (const auto& [name, content] : entries) {
    const uLong sum = crc32(0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size()));
    // Flags, method, time, date; what both of an entry's headers say.
    const std::string common = absl::StrCat(zeros(4 + 2), number(0x21, 2), number(sum, 4), number(content.size(), 4),
                                            number(content.size(), 4), number(name.size(), 2), zeros(2));
    absl::StrAppend(&directory, "PK\x01\x02", version, version, common, zeros(2 + 2 + 2 + 4), number(locals.size(), 4),
                    name);
    absl::StrAppend(&locals, "PK\x03\x04", version, common, name, content);
  }
  return absl::StrCat(locals, directory, "PK\x05\x06", zeros(4), number(entries.size(), 2), number(entries.size(), 2),
                      number(directory.size(), 4), number(locals.size(), 4), zeros(2));
}

}  // namespace holdfast
