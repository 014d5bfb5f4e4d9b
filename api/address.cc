// SPDX-License-Identifier: Apache-2.0
#include "api/address.h"

#include "absl/strings/match.h"
#include "absl/strings/strip.h"

namespace holdfast {
namespace {

// One of IPv4's 127.0.0.0/8, by number: names may begin like it.
bool IsLoopbackNumber(absl::string_view host) {
  return absl::StartsWith(host, "127.") && host.find_first_not_of("0123456789.") == absl::string_view::npos;
}

}  // namespace

bool IsLoopback(absl::string_view address) {
  absl::ConsumePrefix(&address, "dns:///");
  return IsLoopbackNumber(address.substr(0, address.find(':'))) || absl::StartsWith(address, "localhost:") ||
         absl::StartsWith(address, "[::1]:");
}

}  // namespace holdfast
