// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

constexpr char kTrackSubprotocol[] = "holdfast.v1";  // of WebSockets that carry a Track stream

// The token of the subprotocol "bearer.BASE64URL" among those that a request offers, as "Bearer TOKEN"; empty: there is
// none. 'offers_protocol' says whether kTrackSubprotocol is among them.
std::string AuthorizationOf(absl::string_view subprotocols, bool& offers_protocol);

}  // namespace holdfast
