// SPDX-License-Identifier: Apache-2.0
// What stands before the values in a .npy file: their type and shape.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

struct NpyHeader {
  char kind = 'f';             // 'f' float, 'i' signed, 'u' unsigned, 'b' bool
  int64_t item_bytes = 4;      // 1, 2, 4 or 8
  std::vector<int64_t> shape;  // row-major
  int64_t values() const;      // product of the shape
};

// No header takes more.
constexpr size_t kMaxNpyHeaderBytes = 64 << 10;

// What is said of a file that holds no valid array; 'what' is wrong with it. DATA_LOSS.
absl::Status DamagedArray(absl::string_view what);

// A .npy header from the beginning of 'bytes', and how many bytes it takes. DATA_LOSS for what is not one;
// UNIMPLEMENTED for arrays that are not little-endian numbers in row-major order.
absl::StatusOr<NpyHeader> ParseNpyHeader(absl::string_view bytes, size_t* header_bytes);

}  // namespace holdfast
