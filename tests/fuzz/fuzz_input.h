// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

// What a fuzz target was given, taken from the front to the back. Any bytes make sense: what is missing is zero or
// empty.
class FuzzInput {
 public:
  FuzzInput(const uint8_t* data, size_t size) : rest_(reinterpret_cast<const char*>(data), size) {}

  bool empty() const { return rest_.empty(); }

  uint8_t TakeByte() {
    const absl::string_view byte = Take(1);
    return byte.empty() ? 0 : static_cast<uint8_t>(byte[0]);
  }

  // Two bytes of length, the lower one first, and that many bytes or as many as there are. Empty at the end.
  std::optional<std::string> TakePiece() {
    if (empty()) return std::nullopt;
    const size_t low = TakeByte(), high = TakeByte();
    return std::string(Take(high << 8 | low));
  }

  absl::string_view TakeRest() { return Take(rest_.size()); }

 private:
  absl::string_view Take(size_t size) {
    const absl::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(taken.size());
    return taken;
  }

  absl::string_view rest_;
};

}  // namespace holdfast
