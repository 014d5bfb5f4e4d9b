// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace grpc {
class ChannelCredentials;
}

namespace holdfast {

// How a client and its servers know each other. Files are in PEM; a changed one counts for new connections.
struct ClientTls {
  bool enabled = false;     // false: plain text, and the rest is empty
  std::string ca;           // authorities whose servers are trusted; empty: the system's
  std::string cert;         // the client's own certificate, where servers ask for one
  std::string key;          // of that certificate
  std::string server_name;  // expected in the server's certificate; empty: the host of the address

  // INVALID_ARGUMENT names the field: a file that cannot be read, a certificate without its key.
  absl::Status Validate() const;
};

// REQUIRES: it is valid.
std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const ClientTls& tls);

// OK for what can travel as a bearer token, the empty one too, which is none. The error does not quote it.
absl::Status CheckToken(absl::string_view token);

}  // namespace holdfast
