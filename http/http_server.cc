// SPDX-License-Identifier: Apache-2.0
#include "http/http_server.h"

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <chrono>
#include <utility>

#include "absl/strings/string_view.h"
#include "http/listener.h"

namespace holdfast {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using beast::error_code;
using boost::asio::ip::tcp;

constexpr std::chrono::seconds kRequestTime(1);
constexpr std::chrono::seconds kAnswerTime(10);  // to be taken
constexpr size_t kHeaderBytes = 8 << 10;
constexpr int kMaxConnections = 256;  // at once; further ones are closed

// What came is no HTTP, or more of it than is taken in; otherwise the connection is over.
bool IsMalformed(error_code error) { return error.category() == make_error_code(http::error::bad_version).category(); }

// A connection with its one request. Lives as long as its handlers.
class Exchange final : public std::enable_shared_from_this<Exchange> {
 public:
  Exchange(tcp::socket socket, const HttpPages& pages, std::shared_ptr<void> place)
      : stream_(std::move(socket)), pages_(pages), place_(std::move(place)) {}

  void Begin() {
    parser_.header_limit(kHeaderBytes);
    stream_.expires_after(kRequestTime);
    http::async_read_header(stream_, buffer_, parser_, [self = shared_from_this()](error_code error, size_t) {
      if (!error) return self->Send(self->Answer());
      if (IsMalformed(error)) self->Send(TextPage(400, "bad request\n"));
    });
  }

 private:
  HttpPage Answer() const {
    const auto& request = parser_.get();
    if (request.method() != http::verb::get && request.method() != http::verb::head) {
      return TextPage(405, "expected GET or HEAD\n");
    }
    const absl::string_view target(request.target().data(), request.target().size());
    const auto page = pages_.find(target.substr(0, target.find('?')));
    return page == pages_.end() ? TextPage(404, "not found\n") : page->second();
  }

  void Send(HttpPage page) {
    const auto& request = parser_.get();
    response_.version(request.version());
    response_.result(static_cast<unsigned>(page.code));
    response_.set(http::field::content_type, page.content_type);
    if (page.code == 405) response_.set(http::field::allow, "GET, HEAD");
    response_.content_length(page.text.size());  // of HEAD too
    if (request.method() != http::verb::head) response_.body() = std::move(page.text);
    response_.keep_alive(false);
    stream_.expires_after(kAnswerTime);
    http::async_write(stream_, response_, [self = shared_from_this()](error_code, size_t) {
      error_code ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  beast::tcp_stream stream_;
  const HttpPages& pages_;
  const std::shared_ptr<void> place_;
  beast::flat_buffer buffer_{kHeaderBytes};
  http::request_parser<http::empty_body> parser_;
  http::response<http::string_body> response_;
};

}  // namespace

HttpPage TextPage(int code, std::string text) { return {code, "text/plain; charset=utf-8", std::move(text)}; }

HttpPage MetricsPage(std::string text) { return {200, "text/plain; version=0.0.4; charset=utf-8", std::move(text)}; }

class HttpServer::Impl {
 public:
  explicit Impl(HttpPages pages) : pages_(std::move(pages)) {}

  absl::Status Listen(const std::string& address) {
    auto listener = Listener::Start(
        address,
        {[this](tcp::socket socket, const tcp::endpoint&) { Take(std::move(socket)); }, [](const std::string&) {}});
    if (!listener.ok()) return listener.status();
    listener_ = *std::move(listener);
    return absl::OkStatus();
  }

  int port() const { return listener_->port(); }

 private:
  void Take(tcp::socket socket) {
    if (place_.use_count() > kMaxConnections) return;  // which closes it
    std::make_shared<Exchange>(std::move(socket), pages_, place_)->Begin();
  }

  const HttpPages pages_;
  // Held by every connection, so that its count tells how many there are.
  const std::shared_ptr<void> place_ = std::make_shared<int>();
  std::unique_ptr<Listener> listener_;  // last: its thread uses the rest
};

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpServer::~HttpServer() = default;
int HttpServer::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const std::string& address, HttpPages pages) {
  auto impl = std::make_unique<Impl>(std::move(pages));
  if (absl::Status status = impl->Listen(address); !status.ok()) return status;
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

}  // namespace holdfast
