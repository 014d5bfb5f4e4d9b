// SPDX-License-Identifier: Apache-2.0
#include "server/web/web_server.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/error.hpp>
#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/address.h"
#include "server/web/http_connection.h"

namespace holdfast {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::beast::error_code;

constexpr std::chrono::milliseconds kPauseAfterError(100);

// As gRPC names its callers.
std::string NameOf(const tcp::endpoint& peer) {
  const auto address = peer.address();
  const bool brackets = address.is_v6();
  return absl::StrCat(brackets ? "ipv6:[" : "ipv4:", address.to_string(), brackets ? "]:" : ":", peer.port());
}

}  // namespace

class WebServer::Impl {
 public:
  Impl(const WebOptions& options, ServedStreams& streams, std::shared_ptr<spdlog::logger> log)
      : site_{streams,
              {IsLoopback(options.listen), options.origins},
              {options.max_message_bytes, options.keepalive_time}},
        max_connections_(options.max_connections),
        log_(std::move(log)) {}
  ~Impl() {
    context_.stop();
    if (thread_.joinable()) thread_.join();
  }

  absl::Status Listen(const std::string& address) {
    const std::optional<HostPort> parts = SplitHostPort(address);
    if (!parts) return absl::InvalidArgumentError(absl::StrCat("web_listen is '", address, "', expected host:port"));
    error_code error;
    tcp::resolver resolver(context_);
    const auto found = resolver.resolve(parts->host, absl::StrCat(parts->port), tcp::resolver::passive, error);
    if (!error) error = ListenAt(found.begin()->endpoint());
    if (error) {
      return absl::UnavailableError(absl::StrCat("cannot listen on ", address, " for the web: ", error.message()));
    }
    Accept();
    thread_ = std::thread([this] { context_.run(); });
    return absl::OkStatus();
  }

  int port() const { return acceptor_.local_endpoint().port(); }

 private:
  error_code ListenAt(const tcp::endpoint& endpoint) {
    error_code error;
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    return error;
  }

  void Accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error) return Pause(error);
      Take(std::move(socket));
      Accept();
    });
  }

  // Descriptors may have run out: trying again at once would only keep the processor busy.
  void Pause(error_code error) {
    log_->warn(absl::StrCat("the web port takes no connection: ", error.message()));
    pause_.expires_after(kPauseAfterError);
    pause_.async_wait([this](error_code) { Accept(); });
  }

  void Take(tcp::socket socket) {
    error_code error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error || site_.place.use_count() > max_connections_) return;  // which closes it
    socket.set_option(tcp::no_delay(true), error);
    std::make_shared<HttpConnection>(std::move(socket), site_, NameOf(peer))->Begin();
  }

  const WebSite site_;  // before what runs handlers
  const int max_connections_;
  const std::shared_ptr<spdlog::logger> log_;
  asio::io_context context_{1};
  tcp::acceptor acceptor_{context_};
  asio::steady_timer pause_{context_};
  std::thread thread_;
};

WebServer::WebServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
WebServer::~WebServer() = default;
int WebServer::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<WebServer>> WebServer::Start(const WebOptions& options, ServedStreams& streams,
                                                            std::shared_ptr<spdlog::logger> log) {
  auto impl = std::make_unique<Impl>(options, streams, std::move(log));
  if (absl::Status status = impl->Listen(options.listen); !status.ok()) return status;
  return std::unique_ptr<WebServer>(new WebServer(std::move(impl)));
}

}  // namespace holdfast
