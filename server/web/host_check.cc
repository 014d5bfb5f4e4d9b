// SPDX-License-Identifier: Apache-2.0
#include "server/web/host_check.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "api/address.h"

namespace holdfast {
namespace {

// Whether a page of this origin came from 'host', which may have the port that the scheme has anyhow.
bool IsFrom(absl::string_view origin, absl::string_view host) {
  const bool tls = absl::ConsumePrefix(&origin, "https://");
  if (!tls && !absl::ConsumePrefix(&origin, "http://")) return false;
  absl::ConsumeSuffix(&host, tls ? ":443" : ":80");
  return !host.empty() && absl::EqualsIgnoreCase(origin, host);
}

// A host without its port. IPv6 has colons of its own, in brackets.
absl::string_view NameOf(absl::string_view host) {
  const size_t colon = host.rfind(':');
  return host.substr(0, host.find(']', colon) == absl::string_view::npos ? colon : absl::string_view::npos);
}

absl::string_view NameOfOrigin(absl::string_view origin) {
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(origin, absl::MaxSplits("://", 1));
  return NameOf(parts.second);
}

bool HasOnly(absl::string_view text, absl::string_view letters) {
  return !text.empty() && text.find_first_not_of(letters) == absl::string_view::npos;
}

bool IsName(absl::string_view name) {
  if (absl::ConsumePrefix(&name, "[")) return absl::ConsumeSuffix(&name, "]") && HasOnly(name, "0123456789abcdef:.");
  return HasOnly(name, "abcdefghijklmnopqrstuvwxyz0123456789-._");
}

// Of a host: none, or ":PORT".
bool IsPort(absl::string_view port, absl::string_view scheme) {
  if (port.empty()) return true;
  int number = 0;
  const bool usual = (scheme == "http" && port == ":80") || (scheme == "https" && port == ":443");
  return !usual && absl::SimpleAtoi(port.substr(1), &number) && number > 0 && number <= 65535 &&
         absl::StrCat(":", number) == port;
}

bool IsOwnMachine(absl::string_view host) { return IsLoopback(absl::StrCat(host, ":")); }

}  // namespace

bool IsOrigin(absl::string_view origin) {
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(origin, absl::MaxSplits("://", 1));
  const auto& [scheme, host] = parts;
  const absl::string_view name = NameOf(host);
  return HasOnly(scheme, "abcdefghijklmnopqrstuvwxyz0123456789+-.") && IsName(name) &&
         IsPort(host.substr(name.size()), scheme);
}

absl::Status CheckHost(const HostRules& rules, absl::string_view host, absl::string_view origin) {
  // By its name alone: a site that has its name point here has another one, and not every proxy tells the port.
  const auto names_host = [name = NameOf(host)](const std::string& listed) {
    return !name.empty() && absl::EqualsIgnoreCase(NameOfOrigin(listed), name);
  };
  const auto& listed = rules.origins;
  if (rules.loopback && !IsOwnMachine(host) && std::none_of(listed.begin(), listed.end(), names_host)) {
    return absl::PermissionDeniedError(absl::StrCat("host is '", host, "', expected this machine, to which alone the ",
                                                    "server listens, or that of an origin of --web_origins"));
  }
  if (origin.empty() || IsFrom(origin, host)) return absl::OkStatus();
  if (std::find(listed.begin(), listed.end(), origin) != listed.end()) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("origin is '", origin, "', expected the server's own or one of --web_origins"));
}

}  // namespace holdfast
