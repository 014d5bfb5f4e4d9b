// SPDX-License-Identifier: Apache-2.0
#include "client/cli/hop_bounds.h"

#include <algorithm>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace holdfast {
namespace {

constexpr char kAuto[] = "auto";

}  // namespace

bool AbslParseFlag(absl::string_view text, HopBounds* bounds, std::string* error) {
  *bounds = {};
  if (text == kAuto) {
    bounds->most = HopBounds::kAutoMost;
    return true;
  }
  const std::pair<absl::string_view, absl::string_view> ends = absl::StrSplit(text, absl::MaxSplits("..", 1));
  const bool single = ends.first.size() == text.size();
  if (absl::SimpleAtoi(ends.first, &bounds->least) && bounds->least >= 0 &&
      (single || (absl::SimpleAtoi(ends.second, &bounds->most) && bounds->most >= std::max(bounds->least, 1)))) {
    return true;
  }
  *error = "expected a number of frames, two of them such as 4..16, or auto";
  return false;
}

std::string AbslUnparseFlag(HopBounds bounds) {
  if (bounds == HopBounds{0, HopBounds::kAutoMost}) return kAuto;
  return bounds.most == 0 ? absl::StrCat(bounds.least) : absl::StrCat(bounds.least, "..", bounds.most);
}

}  // namespace holdfast
