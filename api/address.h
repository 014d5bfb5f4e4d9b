// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

struct HostPort {
  std::string host;  // a name or a number, IPv6 without brackets; may be empty
  int port = 0;      // 0 .. 65535
};

// Of host:port or [host]:port; none where the text is neither.
std::optional<HostPort> SplitHostPort(absl::string_view address);

// Whether the number behind the last colon is beyond every port, of a URI such as dns:///host:port too: gRPC takes it
// modulo 65536. Sockets of the file system ("unix:") have no port.
bool PortIsTooLarge(absl::string_view address);

// Whether host:port means this machine alone, as far as its text says: what goes there crosses no network.
bool IsLoopback(absl::string_view address);

}  // namespace holdfast
