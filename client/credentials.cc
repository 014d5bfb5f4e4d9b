// SPDX-License-Identifier: Apache-2.0
#include "client/credentials.h"

#include <grpcpp/security/credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "api/errors.h"

namespace holdfast {
namespace {

namespace tls_api = grpc::experimental;

constexpr unsigned int kCheckSeconds = 1;  // how often files are looked at
constexpr size_t kMaxBearerBytes = 1024;

// gRPC's own reader of files says nothing of one that is missing, and connects to nobody.
absl::Status CheckReadable(absl::string_view field, const std::string& path) {
  if (path.empty() || std::ifstream(path).good()) return absl::OkStatus();
  return InvalidFieldError(field, absl::StrCat("is \"", path, "\", expected a file that can be read"));
}

}  // namespace

absl::Status ClientTls::Validate() const {
  if (!enabled && !(ca.empty() && cert.empty() && key.empty() && server_name.empty())) {
    return InvalidFieldError("tls.enabled", "is false, expected true where another field of it is set");
  }
  if (cert.empty() != key.empty()) {
    return InvalidFieldError(cert.empty() ? "tls.cert" : "tls.key",
                             "is empty; a certificate and its key come together");
  }
  absl::Status status;
  for (const auto& [field, path] : std::initializer_list<std::pair<absl::string_view, std::string>>{
           {"tls.ca", ca}, {"tls.cert", cert}, {"tls.key", key}}) {
    status.Update(CheckReadable(field, path));
  }
  return status;
}

std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const ClientTls& tls) {
  if (!tls.enabled) return grpc::InsecureChannelCredentials();
  tls_api::TlsChannelCredentialsOptions options;
  if (!tls.ca.empty() || !tls.cert.empty()) {
    options.set_certificate_provider(
        std::make_shared<tls_api::FileWatcherCertificateProvider>(tls.key, tls.cert, tls.ca, kCheckSeconds));
  }
  if (!tls.ca.empty()) options.watch_root_certs();
  if (!tls.cert.empty()) options.watch_identity_key_cert_pairs();
  return tls_api::TlsCredentials(options);
}

absl::Status CheckToken(absl::string_view token) {
  if (token.size() > kMaxBearerBytes) {
    return InvalidFieldError("token",
                             absl::StrCat("has ", token.size(), " characters, expected at most ", kMaxBearerBytes));
  }
  if (std::all_of(token.begin(), token.end(), absl::ascii_isgraph)) return absl::OkStatus();
  return InvalidFieldError("token", "expected printable characters without blanks");
}

}  // namespace holdfast
