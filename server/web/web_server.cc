// SPDX-License-Identifier: Apache-2.0
#include "server/web/web_server.h"

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/error.hpp>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/address.h"
#include "http/listener.h"
#include "server/web/http_connection.h"

namespace holdfast {
namespace {

using boost::asio::ip::tcp;

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

  absl::Status Listen(const std::string& address) {
    auto listener = Listener::Start(
        address,
        {[this](tcp::socket socket, const tcp::endpoint& peer) { Take(std::move(socket), peer); },
         [this](const std::string& why) { log_->warn(absl::StrCat("the web port takes no connection: ", why)); }});
    if (!listener.ok()) return listener.status();
    listener_ = *std::move(listener);
    return absl::OkStatus();
  }

  int port() const { return listener_->port(); }

 private:
  void Take(tcp::socket socket, const tcp::endpoint& peer) {
    if (site_.place.use_count() > max_connections_) return;  // which closes it
    boost::beast::error_code ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    std::make_shared<HttpConnection>(std::move(socket), site_, NameOf(peer))->Begin();
  }

  const WebSite site_;
  const int max_connections_;
  const std::shared_ptr<spdlog::logger> log_;
  std::unique_ptr<Listener> listener_;  // last: its thread uses the rest
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
