// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// Runs 'work'. RESOURCE_EXHAUSTED where memory ended, INTERNAL with the text 'failure' for whatever else it throws: the
// words of an exception may hold paths, which are not for clients.
absl::Status StatusOf(absl::FunctionRef<void()> work, absl::string_view failure);

}  // namespace holdfast
