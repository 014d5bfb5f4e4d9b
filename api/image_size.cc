// SPDX-License-Identifier: Apache-2.0
#include "api/image_size.h"

#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace holdfast {

std::string ToString(ImageSize size) { return absl::StrCat(size.width, "x", size.height); }

absl::StatusOr<ImageSize> ParseImageSize(absl::string_view text) {
  const std::pair<absl::string_view, absl::string_view> sides = absl::StrSplit(text, absl::MaxSplits('x', 1));
  ImageSize size;
  if (absl::SimpleAtoi(sides.first, &size.width) && absl::SimpleAtoi(sides.second, &size.height) && size.width > 0 &&
      size.height > 0) {
    return size;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("expected WIDTHxHEIGHT, for example 512x384; got '", absl::CHexEscape(text.substr(0, 40)), "'"));
}

bool AbslParseFlag(absl::string_view text, ImageSize* size, std::string* error) {
  if (text.empty()) {
    *size = {};
    return true;
  }
  const absl::StatusOr<ImageSize> parsed = ParseImageSize(text);
  if (parsed.ok()) {
    *size = *parsed;
  } else {
    *error = std::string(parsed.status().message());
  }
  return parsed.ok();
}

std::string AbslUnparseFlag(ImageSize size) { return size.empty() ? "" : ToString(size); }

}  // namespace holdfast
