// SPDX-License-Identifier: Apache-2.0
#include "server/health_check.h"

#include <civetweb.h>

#include <array>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "api/address.h"
#include "api/errors.h"

namespace holdfast {
namespace {

constexpr char kRequest[] = "GET /readyz HTTP/1.0\r\n\r\n";
constexpr int kReady = 200;

struct Close {
  void operator()(mg_connection* connection) const { mg_close_connection(connection); }
};

// What listens on every address of the machine listens on this one too.
std::string HostToAsk(const std::string& host) { return host.empty() || host == "0.0.0.0" ? "127.0.0.1" : host; }

absl::Status NotHealthy(const std::string& metrics_listen, absl::string_view why) {
  return absl::UnavailableError(absl::StrCat("the server at ", metrics_listen, " ", why));
}

}  // namespace

absl::Status CheckHealth(const std::string& metrics_listen, absl::Duration timeout) {
  const std::optional<HostPort> parts = SplitHostPort(metrics_listen);
  if (!parts || parts->port == 0) {
    return InvalidFieldError("metrics_listen",
                             absl::StrCat("is \"", metrics_listen, "\", expected host:port with a port other than 0"));
  }
  std::array<char, 256> error{};
  const std::string host = HostToAsk(parts->host);
  const std::unique_ptr<mg_connection, Close> connection(
      mg_connect_client(host.c_str(), parts->port, /*use_ssl=*/0, error.data(), error.size()));
  if (connection == nullptr) return NotHealthy(metrics_listen, absl::StrCat("cannot be reached: ", error.data()));
  mg_write(connection.get(), kRequest, sizeof(kRequest) - 1);
  const int milliseconds = static_cast<int>(absl::ToInt64Milliseconds(timeout));
  if (mg_get_response(connection.get(), error.data(), error.size(), milliseconds) < 0) {
    return NotHealthy(metrics_listen, absl::StrCat("does not answer: ", error.data()));
  }
  const int code = mg_get_response_info(connection.get())->status_code;
  return code == kReady ? absl::OkStatus() : NotHealthy(metrics_listen, absl::StrCat("is not ready: status ", code));
}

}  // namespace holdfast
