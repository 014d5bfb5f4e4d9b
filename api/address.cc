// SPDX-License-Identifier: Apache-2.0
#include "api/address.h"

#include "absl/strings/match.h"
#include "absl/strings/strip.h"

namespace holdfast {

bool IsLoopback(absl::string_view address) {
  absl::ConsumePrefix(&address, "dns:///");
  return absl::StartsWith(address, "127.") || absl::StartsWith(address, "localhost:") ||
         absl::StartsWith(address, "[::1]:");
}

}  // namespace holdfast
