// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "absl/strings/string_view.h"

namespace holdfast {

// Numbers as JPEG and PNG files hold them. REQUIRES: 'bytes' reaches beyond them.
inline uint8_t ByteAt(absl::string_view bytes, size_t at) { return static_cast<uint8_t>(bytes[at]); }

inline uint32_t BigEndian16(absl::string_view bytes, size_t at) {
  return uint32_t{ByteAt(bytes, at)} << 8 | ByteAt(bytes, at + 1);
}

inline uint32_t BigEndian32(absl::string_view bytes, size_t at) {
  return BigEndian16(bytes, at) << 16 | BigEndian16(bytes, at + 2);
}

}  // namespace holdfast
