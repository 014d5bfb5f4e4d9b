// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/strings/string_view.h"

namespace holdfast {

// Whether host:port means this machine alone, as far as its text says: what goes there crosses no network.
bool IsLoopback(absl::string_view address);

}  // namespace holdfast
