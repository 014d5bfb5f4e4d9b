// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace holdfast {

// Files in PEM. All empty: plain text.
struct ServerTls {
  std::string cert;       // the server's certificate, then those that lead to its authority
  std::string key;        // of that certificate
  std::string client_ca;  // authorities whose clients are let in; empty: clients need no certificate

  bool enabled() const { return !cert.empty(); }
  // INVALID_ARGUMENT names the flag: a certificate needs its key, and an authority of clients needs both.
  absl::Status Validate() const;
};

// TLS 1.2 or newer; a changed file is noticed within seconds and counts for new connections. INVALID_ARGUMENT names the
// flag and the file that cannot be read, is no PEM or does not fit the others.
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(const ServerTls& tls);

}  // namespace holdfast
