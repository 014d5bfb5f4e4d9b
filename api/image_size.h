// SPDX-License-Identifier: Apache-2.0
// The size of a picture, and its text "WIDTHxHEIGHT" that flags, messages and logs share.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/limits.h"

namespace holdfast {

struct ImageSize {
  int width = 0;   // pixels
  int height = 0;  // pixels
  bool empty() const { return width == 0 && height == 0; }
  friend bool operator==(const ImageSize& a, const ImageSize& b) { return a.width == b.width && a.height == b.height; }
  friend bool operator!=(const ImageSize& a, const ImageSize& b) { return !(a == b); }
};

inline int64_t Pixels(ImageSize size) { return int64_t{size.width} * size.height; }

inline bool IsUpright(ImageSize size) { return size.height > size.width; }

// 'size' with its sides exchanged if one of both stands upright and the other lies. An empty 'shape' or a square one
// leaves it as it is.
inline ImageSize TurnedLike(ImageSize size, ImageSize shape) {
  const bool turn = shape.height != shape.width && size.height != size.width && IsUpright(shape) != IsUpright(size);
  return turn ? ImageSize{size.height, size.width} : size;
}

// Whether the network can work at this size: both sides positive multiples of kProcessingSizeStep.
constexpr bool IsProcessingSize(ImageSize size) {
  return size.width > 0 && size.height > 0 && size.width % kProcessingSizeStep == 0 &&
         size.height % kProcessingSizeStep == 0;
}

// "512x384"
std::string ToString(ImageSize size);

// Of "512x384". INVALID_ARGUMENT quotes the text and says what was expected; both sides are at least 1.
absl::StatusOr<ImageSize> ParseImageSize(absl::string_view text);

// Makes ImageSize a type of absl flags. An empty text is the empty size, by which flags say "not given".
bool AbslParseFlag(absl::string_view text, ImageSize* size, std::string* error);
std::string AbslUnparseFlag(ImageSize size);

}  // namespace holdfast
