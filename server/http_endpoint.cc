// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <CivetServer.h>

#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

struct Answer {
  int code;
  std::string content_type;
  std::string body;
};

constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kMetricsText[] = "text/plain; version=0.0.4; charset=utf-8";

std::string Head(const Answer& answer) {
  const char* reason = answer.code == 200 ? "OK" : answer.code == 404 ? "Not Found" : "Service Unavailable";
  return absl::StrCat("HTTP/1.1 ", answer.code, " ", reason, "\r\nContent-Type: ", answer.content_type,
                      "\r\nContent-Length: ", answer.body.size(), "\r\nConnection: close\r\n\r\n");
}

// For an address without a host civetweb has another form; both mean every address of IPv4.
std::string WithHost(const std::string& address) {
  return absl::StartsWith(address, ":") ? absl::StrCat("0.0.0.0", address) : address;
}

// A connection has a thread as long as it is open: one that says nothing must not keep a probe waiting.
std::vector<std::string> CivetOptions(const std::string& address) {
  return {"listening_ports",    WithHost(address),
          "num_threads",        "16",
          "request_timeout_ms", "1000",
          "enable_keep_alive",  "no"};
}

}  // namespace

class HttpEndpoint::Impl final : private CivetHandler {
 public:
  // Throws CivetException when it cannot listen.
  Impl(const std::string& address, Handlers handlers) : handlers_(std::move(handlers)), server_(CivetOptions(address)) {
    server_.addHandler("/", *this);  // and everything below
  }

  int port() { return server_.getListeningPorts().front(); }

 private:
  bool handleGet(CivetServer*, mg_connection* connection) override {
    const Answer answer = AnswerTo(connection);
    Write(connection, Head(answer));
    Write(connection, answer.body);
    return true;
  }

  // As GET without the body, whose length it tells (RFC 9110).
  bool handleHead(CivetServer*, mg_connection* connection) override {
    Write(connection, Head(AnswerTo(connection)));
    return true;
  }

  static void Write(mg_connection* connection, const std::string& text) {
    mg_write(connection, text.data(), text.size());
  }

  Answer AnswerTo(const mg_connection* connection) const {
    const absl::string_view path = absl::NullSafeStringView(mg_get_request_info(connection)->local_uri);
    if (path == "/metrics") return {200, kMetricsText, handlers_.metrics()};
    if (path == "/healthz") return {200, kText, "ok\n"};
    if (path != "/readyz") return {404, kText, "not found\n"};
    if (handlers_.ready()) return {200, kText, "ready\n"};
    return {503, kText, "not ready\n"};
  }

  const Handlers handlers_;
  CivetServer server_;  // last: its threads use the handlers
};

HttpEndpoint::HttpEndpoint(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpEndpoint::~HttpEndpoint() = default;
int HttpEndpoint::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(const std::string& address, Handlers handlers) {
  try {
    return std::unique_ptr<HttpEndpoint>(new HttpEndpoint(std::make_unique<Impl>(address, std::move(handlers))));
  } catch (const CivetException&) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", address, " for HTTP"));
  }
}

}  // namespace holdfast
