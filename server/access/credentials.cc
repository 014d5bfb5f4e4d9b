// SPDX-License-Identifier: Apache-2.0
#include "server/access/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/err.h>
#include <openssl/ssl.h>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

namespace tls_api = grpc::experimental;

constexpr unsigned int kCheckSeconds = 1;  // how often files are looked at

absl::Status BadFile(absl::string_view flag, const std::string& path, absl::string_view expected) {
  const char* const reason = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return absl::InvalidArgumentError(absl::StrCat("--", flag, "=", path, ": expected ", expected,
                                                 reason == nullptr ? "" : ": ", reason ? reason : ""));
}

// gRPC's own reader of files says nothing of one that is missing or wrong, and serves nobody.
absl::Status CheckFiles(const ServerTls& tls) {
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_server_method()), &SSL_CTX_free);
  if (context == nullptr) return absl::InternalError("OpenSSL has no context");
  ERR_clear_error();
  if (SSL_CTX_use_certificate_chain_file(context.get(), tls.cert.c_str()) != 1) {
    return BadFile("tls_cert", tls.cert, "a certificate in PEM");
  }
  if (SSL_CTX_use_PrivateKey_file(context.get(), tls.key.c_str(), SSL_FILETYPE_PEM) != 1) {
    return BadFile("tls_key", tls.key, "the certificate's private key in PEM");
  }
  if (!tls.client_ca.empty() && SSL_CTX_load_verify_file(context.get(), tls.client_ca.c_str()) != 1) {
    return BadFile("tls_client_ca", tls.client_ca, "certificates in PEM");
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ServerTls::Validate() const {
  if (cert.empty() != key.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(cert.empty() ? "tls_cert" : "tls_key",
                     " is empty, expected a file: ", "a certificate and its key come together"));
  }
  if (!client_ca.empty() && cert.empty()) {
    return absl::InvalidArgumentError("tls_client_ca is given, expected tls_cert and tls_key beside it");
  }
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(const ServerTls& tls) {
  if (!tls.enabled()) return grpc::InsecureServerCredentials();
  if (absl::Status status = CheckFiles(tls); !status.ok()) return status;
  const bool asks_clients = !tls.client_ca.empty();
  tls_api::TlsServerCredentialsOptions options(
      std::make_shared<tls_api::FileWatcherCertificateProvider>(tls.key, tls.cert, tls.client_ca, kCheckSeconds));
  options.watch_identity_key_cert_pairs();
  if (asks_clients) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  return tls_api::TlsServerCredentials(options);
}

}  // namespace holdfast
