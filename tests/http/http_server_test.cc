// SPDX-License-Identifier: Apache-2.0
#include "http/http_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const asio::ip::address kIpv4 = asio::ip::address_v4::loopback();
const asio::ip::address kIpv6 = asio::ip::address_v6::loopback();

std::unique_ptr<HttpServer> Serve(const std::string& address) {
  auto server = HttpServer::Start(address, {{"/page", [] { return TextPage(200, "a page\n"); }}});
  EXPECT_THAT(server, IsOk());
  return server.ok() ? *std::move(server) : nullptr;
}

// A connection to a server of this machine.
class Call {
 public:
  explicit Call(int port, const asio::ip::address& host = kIpv4) {
    socket_.connect({host, static_cast<uint16_t>(port)}, error_);
  }
  Call& Say(const std::string& bytes) {
    asio::write(socket_, asio::buffer(bytes), error_);
    return *this;
  }
  // Until the server ends the connection.
  std::string Hear() {
    std::string answer;
    asio::read(socket_, asio::dynamic_buffer(answer), error_);
    return answer;
  }

 private:
  asio::io_context context_;
  tcp::socket socket_{context_};
  boost::system::error_code error_;
};

std::string Get(int port, const std::string& target, const asio::ip::address& host = kIpv4) {
  return Call(port, host).Say(absl::StrCat("GET ", target, " HTTP/1.1\r\nHost: localhost\r\n\r\n")).Hear();
}

bool MachineHasIpv6() {
  asio::io_context context;
  boost::system::error_code error;
  tcp::acceptor acceptor(context);
  acceptor.open(tcp::v6(), error);
  if (!error) acceptor.bind({kIpv6, 0}, error);
  return !error;
}

TEST(HttpServerTest, ServesPagesByTheirPaths) {
  const auto server = Serve("127.0.0.1:0");
  EXPECT_THAT(Get(server->port(), "/page"), AllOf(StartsWith("HTTP/1.1 200 OK\r\n"), HasSubstr("Connection: close\r\n"),
                                                  HasSubstr("Content-Type: text/plain; charset=utf-8\r\n"),
                                                  HasSubstr("Content-Length: 7\r\n"), EndsWith("\r\n\r\na page\n")));
  EXPECT_THAT(Get(server->port(), "/page?query"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(Get(server->port(), "/pages"), StartsWith("HTTP/1.1 404 Not Found"));
}

TEST(HttpServerTest, SpeaksToOldClientsToo) {
  const auto server = Serve("127.0.0.1:0");
  EXPECT_THAT(Call(server->port()).Say("GET /page HTTP/1.0\r\n\r\n").Hear(),
              AllOf(StartsWith("HTTP/1.0 200 OK\r\n"), EndsWith("\r\n\r\na page\n")));
}

TEST(HttpServerTest, ServesNothingButPages) {
  const auto server = Serve("127.0.0.1:0");
  EXPECT_THAT(Call(server->port()).Say("POST /page HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc").Hear(),
              AllOf(StartsWith("HTTP/1.1 405 Method Not Allowed"), HasSubstr("Allow: GET, HEAD\r\n")));
}

TEST(HttpServerTest, ListensOverIpv6) {
  if (!MachineHasIpv6()) GTEST_SKIP() << "this machine has no IPv6";
  EXPECT_THAT(Get(Serve("[::1]:0")->port(), "/page", kIpv6), StartsWith("HTTP/1.1 200"));
  const auto everywhere = Serve("[::]:0");
  EXPECT_THAT(Get(everywhere->port(), "/page", kIpv6), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(Get(everywhere->port(), "/page"), StartsWith("HTTP/1.1 200"));
}

TEST(HttpServerTest, WithoutAHostItListensEverywhere) {
  const auto server = Serve(":0");
  EXPECT_THAT(Get(server->port(), "/page"), StartsWith("HTTP/1.1 200"));
  if (MachineHasIpv6()) {
    EXPECT_THAT(Get(server->port(), "/page", kIpv6), StartsWith("HTTP/1.1 200"));
  }
}

TEST(HttpServerTest, AnAddressThatCannotBeHadIsAnError) {
  EXPECT_THAT(HttpServer::Start("nowhere", {}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("host:port")));
  const auto server = Serve("127.0.0.1:0");
  EXPECT_THAT(HttpServer::Start(absl::StrCat("127.0.0.1:", server->port()), {}),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("cannot listen on 127.0.0.1:")));
}

TEST(HttpServerTest, GarbageIsRefused) {
  const auto server = Serve("127.0.0.1:0");
  EXPECT_THAT(Call(server->port()).Say("\xff garbage\r\n\r\n").Hear(), StartsWith("HTTP/1.1 400 Bad Request"));
  // What is sent behind the end may take the answer away.
  EXPECT_THAT(Call(server->port()).Say("GET /page HTTP/1.1\r\nX: " + std::string(1 << 20, 'x')).Hear(),
              AnyOf(StartsWith("HTTP/1.1 400 Bad Request"), IsEmpty()));
  EXPECT_THAT(Get(server->port(), "/page"), StartsWith("HTTP/1.1 200"));
}

TEST(HttpServerTest, SilentAndSlowConnectionsHoldNobodyUpAndAreEnded) {
  const auto server = Serve("127.0.0.1:0");
  std::vector<std::unique_ptr<Call>> calls;
  for (int i = 0; i < 200; ++i) {
    calls.push_back(std::make_unique<Call>(server->port()));
    if (i % 2 == 0) calls.back()->Say("GET /page HTTP/1.1\r\n");
  }
  EXPECT_THAT(Get(server->port(), "/page"), StartsWith("HTTP/1.1 200"));
  for (const auto& call : calls) EXPECT_THAT(call->Hear(), IsEmpty());
}

TEST(HttpServerTest, ConnectionsBeyondAllBoundsAreClosed) {
  const auto server = Serve("127.0.0.1:0");
  std::vector<std::unique_ptr<Call>> calls;
  for (int i = 0; i < 300; ++i) calls.push_back(std::make_unique<Call>(server->port()));
  for (const auto& call : calls) call->Hear();
  EXPECT_THAT(Get(server->port(), "/page"), StartsWith("HTTP/1.1 200"));
}

TEST(HttpServerTest, EndsWhileConnectionsAreOpen) {
  auto server = Serve("127.0.0.1:0");
  Call call(server->port());
  call.Say("GET /page");
  server.reset();
  EXPECT_THAT(call.Hear(), IsEmpty());
}

}  // namespace
}  // namespace holdfast
