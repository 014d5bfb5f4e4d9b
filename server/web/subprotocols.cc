// SPDX-License-Identifier: Apache-2.0
#include "server/web/subprotocols.h"

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace holdfast {
namespace {

constexpr char kTokenPrefix[] = "bearer.";

}  // namespace

std::string AuthorizationOf(absl::string_view subprotocols, bool& offers_protocol) {
  std::string authorization;
  offers_protocol = false;
  for (absl::string_view offered : absl::StrSplit(subprotocols, ',')) {
    offered = absl::StripAsciiWhitespace(offered);
    std::string token;
    if (offered == kTrackSubprotocol) offers_protocol = true;
    if (absl::ConsumePrefix(&offered, kTokenPrefix) && absl::WebSafeBase64Unescape(offered, &token)) {
      authorization = absl::StrCat("Bearer ", token);
    }
  }
  return authorization;
}

}  // namespace holdfast
