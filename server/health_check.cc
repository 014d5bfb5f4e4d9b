// SPDX-License-Identifier: Apache-2.0
#include "server/health_check.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "api/address.h"
#include "api/errors.h"

namespace holdfast {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using beast::error_code;

constexpr unsigned kReady = 200;

// What listens on every address of the machine listens on one of these too. With [::] that is IPv4 as well, and the
// only one where IPv6 is switched off.
std::vector<std::string> HostsToAsk(const std::string& host) {
  if (host == "::") return {"::1", "127.0.0.1"};
  return {host.empty() || host == "0.0.0.0" ? "127.0.0.1" : host};
}

absl::Status NotHealthy(const std::string& metrics_listen, absl::string_view why) {
  return absl::UnavailableError(absl::StrCat("the server at ", metrics_listen, " ", why));
}

// A connection for one request, whose steps together take no longer than 'timeout'.
class Probe {
 public:
  explicit Probe(absl::Duration timeout) { stream_.expires_after(absl::ToChronoMilliseconds(timeout)); }

  error_code Connect(const HostPort& address) {
    error_code error;
    std::vector<tcp::endpoint> found;
    for (const std::string& host : HostsToAsk(address.host)) {
      const auto here = tcp::resolver(context_).resolve(host, absl::StrCat(address.port), error);
      found.insert(found.end(), here.begin(), here.end());
    }
    if (found.empty()) return error;
    stream_.async_connect(found, [&error](error_code result, const tcp::endpoint&) { error = result; });
    Run();
    return error;
  }

  // Sets 'code' to that of the answer.
  error_code Ask(const char* path, unsigned& code) {
    http::request<http::empty_body> request(http::verb::get, path, 11);
    request.set(http::field::host, "localhost");
    request.keep_alive(false);
    beast::flat_buffer buffer;
    http::response_parser<http::empty_body> answer;
    error_code error;
    http::async_write(stream_, request, [&](error_code result, size_t) {
      if ((error = result)) return;
      http::async_read_header(stream_, buffer, answer, [&error](error_code read, size_t) { error = read; });
    });
    Run();
    code = answer.get().result_int();
    return error;
  }

 private:
  void Run() {
    context_.restart();
    context_.run();
  }

  asio::io_context context_{1};
  beast::tcp_stream stream_{context_};
};

}  // namespace

absl::Status CheckHealth(const std::string& metrics_listen, absl::Duration timeout) {
  const std::optional<HostPort> parts = SplitHostPort(metrics_listen);
  if (!parts || parts->port == 0) {
    return InvalidFieldError("metrics_listen",
                             absl::StrCat("is \"", metrics_listen, "\", expected host:port with a port other than 0"));
  }
  Probe probe(timeout);
  if (const error_code error = probe.Connect(*parts)) {
    return NotHealthy(metrics_listen, absl::StrCat("cannot be reached: ", error.message()));
  }
  unsigned code = 0;
  if (const error_code error = probe.Ask("/readyz", code)) {
    return NotHealthy(metrics_listen, absl::StrCat("does not answer: ", error.message()));
  }
  return code == kReady ? absl::OkStatus() : NotHealthy(metrics_listen, absl::StrCat("is not ready: status ", code));
}

}  // namespace holdfast
