// SPDX-License-Identifier: Apache-2.0
#include "http/listener.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "api/address.h"

namespace holdfast {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::chrono::milliseconds kPauseAfterError(100);

}  // namespace

class Listener::Impl {
 public:
  explicit Impl(Events events) : events_(std::move(events)) {}
  ~Impl() {
    context_.stop();
    if (thread_.joinable()) thread_.join();
  }

  // Listens at the first of the host's addresses that can be had.
  error_code Listen(const HostPort& address) {
    error_code error = asio::error::host_not_found;
    for (const tcp::endpoint& endpoint : EndpointsOf(address, error)) {
      error = ListenAt(endpoint);
      if (!error) break;
    }
    return error;
  }

  void Begin() {
    Accept();
    thread_ = std::thread([this] { context_.run(); });
  }

  int port() const { return acceptor_.local_endpoint().port(); }

 private:
  std::vector<tcp::endpoint> EndpointsOf(const HostPort& address, error_code& error) {
    const auto port = static_cast<uint16_t>(address.port);
    if (address.host.empty()) return {{tcp::v6(), port}, {tcp::v4(), port}};  // the second without IPv6
    const auto found = tcp::resolver(context_).resolve(address.host, absl::StrCat(port), tcp::resolver::passive, error);
    return {found.begin(), found.end()};
  }

  error_code ListenAt(const tcp::endpoint& endpoint) {
    error_code error, ignored;
    acceptor_.close(ignored);
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    // [::] means the addresses of IPv4 too, whatever the system takes it for.
    if (!error && endpoint.protocol() == tcp::v6()) acceptor_.set_option(asio::ip::v6_only(false), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    return error;
  }

  void Accept() {
    acceptor_.async_accept([this](error_code error, tcp::socket socket) {
      if (error) return Pause(error);
      const tcp::endpoint peer = socket.remote_endpoint(error);
      if (!error) events_.accepted(std::move(socket), peer);
      Accept();
    });
  }

  // Descriptors may have run out: trying again at once would only keep the processor busy.
  void Pause(error_code error) {
    events_.failed(error.message());
    pause_.expires_after(kPauseAfterError);
    pause_.async_wait([this](error_code) { Accept(); });
  }

  const Events events_;
  asio::io_context context_{1};
  tcp::acceptor acceptor_{context_};
  asio::steady_timer pause_{context_};
  std::thread thread_;
};

Listener::Listener(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Listener::~Listener() = default;
int Listener::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<Listener>> Listener::Start(const std::string& address, Events events) {
  const std::optional<HostPort> parts = SplitHostPort(address);
  if (!parts) return absl::InvalidArgumentError(absl::StrCat("address is '", address, "', expected host:port"));
  auto impl = std::make_unique<Impl>(std::move(events));
  if (const error_code error = impl->Listen(*parts)) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", address, ": ", error.message()));
  }
  impl->Begin();
  return std::unique_ptr<Listener>(new Listener(std::move(impl)));
}

}  // namespace holdfast
