// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

// Accepts TCP connections, on a thread of its own, which all that is started on their sockets runs on too.
class Listener {
 public:
  struct Events {
    std::function<void(boost::asio::ip::tcp::socket socket, const boost::asio::ip::tcp::endpoint& peer)> accepted;
    // A connection could not be accepted; the next try is in a moment.
    std::function<void(const std::string& why)> failed;
  };
  // 'address' is host:port; no host: every address of the machine; port 0: a free one. INVALID_ARGUMENT where it is no
  // such text, UNAVAILABLE when it cannot be had.
  static absl::StatusOr<std::unique_ptr<Listener>> Start(const std::string& address, Events events);
  // Drops what runs on the sockets.
  ~Listener();

  int port() const;

 private:
  class Impl;
  explicit Listener(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace holdfast
