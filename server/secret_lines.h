// SPDX-License-Identifier: Apache-2.0
// The form that the server's small files of secrets share: an entry a line; lines that are empty or begin with # are
// passed over.
#pragma once

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// Calls 'take' with each entry, without blanks around it, and the number of its line, which begins at 1. Ends with the
// first error.
absl::Status ForEachEntry(absl::string_view text,
                          absl::FunctionRef<absl::Status(absl::string_view entry, int line)> take);

// INVALID_ARGUMENT that names the line and does not quote it.
absl::Status BadLine(int line, absl::string_view expected);

}  // namespace holdfast
