// SPDX-License-Identifier: Apache-2.0
#include "server/web/host_check.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "api/address.h"

namespace holdfast {
namespace {

// Host and port of an origin; empty where it has none, as "null" of a sandboxed page.
absl::string_view HostOf(absl::string_view origin) {
  if (absl::ConsumePrefix(&origin, "http://") || absl::ConsumePrefix(&origin, "https://")) return origin;
  return "";
}

bool IsOwnMachine(absl::string_view host) { return IsLoopback(absl::StrCat(host, ":")); }

}  // namespace

absl::Status CheckHost(const HostRules& rules, absl::string_view host, absl::string_view origin) {
  const auto names_host = [host](const std::string& listed) { return absl::EqualsIgnoreCase(HostOf(listed), host); };
  const auto& listed = rules.origins;
  if (rules.loopback && !IsOwnMachine(host) && std::none_of(listed.begin(), listed.end(), names_host)) {
    return absl::PermissionDeniedError(absl::StrCat("host is '", host, "', expected this machine, to which alone the ",
                                                    "server listens, or that of an origin of --web_origins"));
  }
  if (origin.empty() || absl::EqualsIgnoreCase(HostOf(origin), host)) return absl::OkStatus();
  if (std::find(listed.begin(), listed.end(), origin) != listed.end()) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("origin is '", origin, "', expected the server's own or one of --web_origins"));
}

}  // namespace holdfast
