// SPDX-License-Identifier: Apache-2.0
#include "tests/support/source_tree.h"

#include "absl/strings/str_cat.h"

namespace holdfast {

std::string InSourceTree(absl::string_view path) { return absl::StrCat(HOLDFAST_SOURCE_DIR, "/", path); }

}  // namespace holdfast
