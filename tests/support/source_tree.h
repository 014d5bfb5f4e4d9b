// SPDX-License-Identifier: Apache-2.0
// Where the files lie that tests read.
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

// The path of a file of the source tree, given relative to its root: "tests/data/x.npz". The root is compiled into this
// library alone, so that a compiler cache can serve several checkouts.
std::string InSourceTree(absl::string_view path);

}  // namespace holdfast
