// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <CivetServer.h>

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

struct Answer {
  int code;
  std::string content_type;
  std::string body;
};

constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kMetricsText[] = "text/plain; version=0.0.4; charset=utf-8";

class Handler final : public CivetHandler {
 public:
  explicit Handler(std::function<Answer()> answer) : answer_(std::move(answer)) {}

  bool handleGet(CivetServer*, mg_connection* connection) override {
    const Answer answer = answer_();
    const std::string head = absl::StrCat("HTTP/1.1 ", answer.code,
                                          answer.code == 200   ? " OK"
                                          : answer.code == 404 ? " Not Found"
                                                               : " Service Unavailable",
                                          "\r\nContent-Type: ", answer.content_type,
                                          "\r\nContent-Length: ", answer.body.size(), "\r\nConnection: close\r\n\r\n");
    mg_write(connection, head.data(), head.size());
    mg_write(connection, answer.body.data(), answer.body.size());
    return true;
  }

 private:
  const std::function<Answer()> answer_;
};

std::vector<std::string> CivetOptions(const std::string& address) {
  return {"listening_ports", address, "num_threads", "2", "request_timeout_ms", "10000", "enable_keep_alive", "no"};
}

}  // namespace

class HttpEndpoint::Impl {
 public:
  // Throws CivetException when it cannot listen.
  Impl(const std::string& address, Handlers handlers)
      : metrics_([f = std::move(handlers.metrics)] {
          return Answer{200, kMetricsText, f()};
        }),
        alive_([] {
          return Answer{200, kText, "ok\n"};
        }),
        ready_([f = std::move(handlers.ready)] {
          return f() ? Answer{200, kText, "ready\n"} : Answer{503, kText, "not ready\n"};
        }),
        nothing_([] {
          return Answer{404, kText, "not found\n"};
        }),
        server_(CivetOptions(address)) {
    server_.addHandler("/", nothing_);
    server_.addHandler("/metrics$", metrics_);
    server_.addHandler("/healthz$", alive_);
    server_.addHandler("/readyz$", ready_);
  }

  int port() { return server_.getListeningPorts().front(); }

 private:
  Handler metrics_;
  Handler alive_;
  Handler ready_;
  Handler nothing_;
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
