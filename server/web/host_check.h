// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// Whose pages may talk to this server from a browser, which sends a user's requests wherever a page asks it to.
struct HostRules {
  bool loopback = true;              // it listens to this machine alone
  std::vector<std::string> origins;  // of pages beside the server's own, as browsers name them: https://tracks.example
};

// Whether it is an origin as browsers name it, which is how origins are compared: scheme://host or scheme://host:port,
// in small letters, without a path, and without the port that http or https has anyhow.
bool IsOrigin(absl::string_view origin);

// 'host' and 'origin' are the headers of a request; an 'origin' that is empty: no page of another site asks. OK: the
// server's own page, one of a listed origin, or no browser. PERMISSION_DENIED: another site's page; or, where the
// server listens to this machine alone, a name that is not this machine's, as a site may have its own name point here.
absl::Status CheckHost(const HostRules& rules, absl::string_view host, absl::string_view origin);

}  // namespace holdfast
