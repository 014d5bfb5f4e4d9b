// SPDX-License-Identifier: Apache-2.0
// A wire between a client and a server of one machine, which a test can make long, cut and lose.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <list>
#include <string>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace holdfast {

// Listens on a free port of 127.0.0.1 and forwards every connection to another port of it, both ways. Thread-safe.
class TcpProxy {
 public:
  // 'latency': what comes from the target takes so long, as from a distant one.
  explicit TcpProxy(int target_port, absl::Duration latency = absl::ZeroDuration())
      : target_port_(target_port), latency_(latency), listener_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address = Local(0);
    socklen_t size = sizeof(address);
    EXPECT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listener_, 16), 0);
    EXPECT_EQ(getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { Accept(); });
  }
  ~TcpProxy() {
    {
      absl::MutexLock lock(&mutex_);
      closed_ = true;
    }
    shutdown(listener_, SHUT_RDWR);  // ends accept()
    acceptor_.join();
    CutAll();
    for (Connection& connection : connections_) Join(connection);
    close(listener_);
  }

  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }
  int port() const { return port_; }

  // Both ends of every connection that stands see it break; later ones are forwarded again.
  void CutAll() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    for (const Connection& connection : connections_) Shut(connection);
  }
  // After so many packets of the client more, nothing comes through a connection that stands, either way, and neither
  // end is told: the path is gone.
  void LoseAfter(int64_t packets) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    for (Connection& connection : connections_) connection.packets_left = packets;
  }
  // The path of the next connection is lost from its first packet on.
  void LoseNext() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    loses_next_ = true;
  }
  // As if nobody listened behind it: connections that stand stay, new ones break at once.
  void RefuseNew(bool refuse) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    refuses_ = refuse;
  }
  // Connections forwarded so far.
  int64_t connections() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return static_cast<int64_t>(connections_.size());
  }

 private:
  // Stays with its sockets until the end, so that a file descriptor is never another one's.
  struct Connection {
    int client = -1;
    int server = -1;
    std::atomic<int64_t> packets_left = std::numeric_limits<int64_t>::max();  // of the client, until the path is lost
    std::thread up;
    std::thread down;
  };

  static sockaddr_in Local(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<uint16_t>(port));
    return address;
  }

  static void Shut(const Connection& connection) {
    shutdown(connection.client, SHUT_RDWR);
    shutdown(connection.server, SHUT_RDWR);
  }

  static void Join(Connection& connection) {
    connection.up.join();
    connection.down.join();
    close(connection.client);
    close(connection.server);
  }

  void Accept() ABSL_LOCKS_EXCLUDED(mutex_) {
    for (int client; (client = accept(listener_, nullptr, nullptr)) >= 0;) {
      if (!Forward(client)) close(client);
    }
  }

  // False: the connection is not taken.
  bool Forward(int client) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    if (closed_ || refuses_) return false;
    const int server = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in target = Local(target_port_);
    if (connect(server, reinterpret_cast<sockaddr*>(&target), sizeof(target)) != 0) {
      close(server);
      return false;
    }
    Connection& connection = connections_.emplace_back();
    connection.client = client;
    connection.server = server;
    if (std::exchange(loses_next_, false)) connection.packets_left = 0;
    std::atomic<int64_t>& left = connection.packets_left;
    connection.up = std::thread([&left, client, server] { Pump(client, server, [&left] { return left-- > 0; }); });
    connection.down = std::thread([this, &left, client, server] {
      Pump(server, client, [this, &left] {
        absl::SleepFor(latency_);
        return left > 0;
      });
    });
    return true;
  }

  // Until one end is gone; then the other one is told. 'passes' says of each packet whether it comes through.
  static void Pump(int from, int to, const std::function<bool()>& passes) {
    std::array<char, 1 << 16> bytes;
    for (ssize_t count; (count = recv(from, bytes.data(), bytes.size(), 0)) > 0;) {
      if (!passes()) continue;
      for (ssize_t sent = 0; sent < count;) {
        const ssize_t more = send(to, bytes.data() + sent, static_cast<size_t>(count - sent), MSG_NOSIGNAL);
        if (more <= 0) return static_cast<void>(shutdown(from, SHUT_RDWR));
        sent += more;
      }
    }
    shutdown(to, SHUT_RDWR);
  }

  const int target_port_;
  const absl::Duration latency_;
  const int listener_;
  int port_ = 0;
  mutable absl::Mutex mutex_;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool refuses_ ABSL_GUARDED_BY(mutex_) = false;
  bool loses_next_ ABSL_GUARDED_BY(mutex_) = false;
  std::list<Connection> connections_ ABSL_GUARDED_BY(mutex_);
  std::thread acceptor_;
};

}  // namespace holdfast
