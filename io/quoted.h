// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// A name that a file gave, as messages show it: in quotes, its first 120 bytes, escaped so that a terminal or a log
// takes no orders from it.
inline std::string Quoted(absl::string_view name) {
  return absl::StrCat("'", absl::CHexEscape(name.substr(0, 120)), "'");
}

}  // namespace holdfast
