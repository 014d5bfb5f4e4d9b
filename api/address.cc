// SPDX-License-Identifier: Apache-2.0
#include "api/address.h"

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/strip.h"

namespace holdfast {
namespace {

constexpr int kMaxPort = 65535;

// One of IPv4's 127.0.0.0/8, by number: names may begin like it.
bool IsLoopbackNumber(absl::string_view host) {
  return absl::StartsWith(host, "127.") && host.find_first_not_of("0123456789.") == absl::string_view::npos;
}

}  // namespace

std::optional<HostPort> SplitHostPort(absl::string_view address) {
  const size_t colon = address.rfind(':');
  HostPort parts;
  if (colon == absl::string_view::npos || !absl::SimpleAtoi(address.substr(colon + 1), &parts.port)) return {};
  if (parts.port < 0 || parts.port > kMaxPort) return {};
  absl::string_view host = address.substr(0, colon);
  if (absl::ConsumePrefix(&host, "[") && !absl::ConsumeSuffix(&host, "]")) return {};
  parts.host = std::string(host);
  return parts;
}

bool PortIsTooLarge(absl::string_view address) {
  if (absl::StartsWith(address, "unix:")) return false;
  const absl::string_view port = address.substr(address.rfind(':') + 1);  // of npos: all of it
  if (port.empty() || port.find_first_not_of("0123456789") != absl::string_view::npos) return false;
  int number = 0;
  return !absl::SimpleAtoi(port, &number) || number > kMaxPort;
}

bool IsLoopback(absl::string_view address) {
  absl::ConsumePrefix(&address, "dns:///");
  return IsLoopbackNumber(address.substr(0, address.find(':'))) || absl::StartsWith(address, "localhost:") ||
         absl::StartsWith(address, "[::1]:");
}

}  // namespace holdfast
