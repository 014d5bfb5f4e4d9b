// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/health_check.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr timeval kPatience = {8, 0};  // of who asks

// A connection on the loopback device; negative: none.
int Connect(int port) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0) return fd;
  close(fd);
  return -1;
}

// The whole answer to a request.
std::string Ask(int port, const std::string& method, const std::string& path) {
  const int fd = Connect(port);
  if (fd < 0) return "no connection";
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof(kPatience));
  const std::string request =
      absl::StrCat(method, " ", path, " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  (void)!send(fd, request.data(), request.size(), MSG_NOSIGNAL);
  std::string answer;
  char buffer[4096];
  for (ssize_t n; (n = recv(fd, buffer, sizeof(buffer), 0)) > 0;) answer.append(buffer, static_cast<size_t>(n));
  close(fd);
  return answer;
}

std::string Get(int port, const std::string& path) { return Ask(port, "GET", path); }

class HttpEndpointTest : public ::testing::Test {
 protected:
  std::atomic<bool> ready_{false};
  std::unique_ptr<HttpServer> endpoint_ = *StartHttpEndpoint(
      "127.0.0.1:0", [] { return std::string("metric 1\n"); }, [this] { return ready_.load(); });
};

TEST_F(HttpEndpointTest, BindsAFreePort) { EXPECT_GT(endpoint_->port(), 0); }

TEST_F(HttpEndpointTest, ServesMetrics) {
  EXPECT_THAT(
      Get(endpoint_->port(), "/metrics"),
      AllOf(StartsWith("HTTP/1.1 200 OK"), HasSubstr("text/plain; version=0.0.4"), EndsWith("\r\n\r\nmetric 1\n")));
}

TEST_F(HttpEndpointTest, IsReadyOnlyWhileTheServerServes) {
  EXPECT_THAT(Get(endpoint_->port(), "/healthz"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(Get(endpoint_->port(), "/readyz"), StartsWith("HTTP/1.1 503 Service Unavailable"));
  ready_ = true;
  EXPECT_THAT(Get(endpoint_->port(), "/readyz"), StartsWith("HTTP/1.1 200"));
}

TEST_F(HttpEndpointTest, HeadIsAnsweredAsGetWithoutTheBody) {
  ready_ = true;
  for (const char* path : {"/metrics", "/healthz", "/readyz", "/none"}) {
    const std::string whole = Get(endpoint_->port(), path);
    EXPECT_EQ(Ask(endpoint_->port(), "HEAD", path), whole.substr(0, whole.find("\r\n\r\n") + 4)) << path;
  }
}

TEST_F(HttpEndpointTest, ConnectionsThatSayNothingHoldNobodyUp) {
  std::vector<int> silent;
  for (int i = 0; i < 40; ++i) silent.push_back(Connect(endpoint_->port()));
  EXPECT_THAT(Get(endpoint_->port(), "/healthz"), StartsWith("HTTP/1.1 200"));
  for (const int fd : silent) close(fd);
}

TEST_F(HttpEndpointTest, KnowsNothingElse) {
  for (const char* path : {"/", "/metrics/x", "/metricsx", "/etc/passwd", "/../etc/passwd"}) {
    EXPECT_THAT(Get(endpoint_->port(), path), ::testing::ContainsRegex("^HTTP/1.1 40[04]")) << path;
  }
}

TEST_F(HttpEndpointTest, TheHealthCheckFollowsReadiness) {
  const std::string everywhere = absl::StrCat("0.0.0.0:", endpoint_->port());
  EXPECT_THAT(CheckHealth(everywhere, absl::Seconds(10)),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("is not ready: status 503")));
  ready_ = true;
  EXPECT_THAT(CheckHealth(everywhere, absl::Seconds(10)), IsOk());
  EXPECT_THAT(CheckHealth(absl::StrCat("localhost:", endpoint_->port()), absl::Seconds(10)), IsOk());
  const int port = endpoint_->port();
  endpoint_.reset();
  EXPECT_THAT(CheckHealth(absl::StrCat("127.0.0.1:", port), absl::Seconds(10)),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("cannot be reached")));
}

TEST(HealthCheckTest, FindsAServerThatListensEverywhere) {
  const auto endpoint = *StartHttpEndpoint(":0", nullptr, [] { return true; });
  for (const char* host : {"", "0.0.0.0"}) {
    EXPECT_THAT(CheckHealth(absl::StrCat(host, ":", endpoint->port()), absl::Seconds(10)), IsOk());
  }
  EXPECT_THAT(CheckHealth(absl::StrCat("[::]:", endpoint->port()), absl::Seconds(10)), IsOk())
      << "where there is no IPv6";
  const auto over_ipv6 = StartHttpEndpoint("[::1]:0", nullptr, [] { return true; });
  if (!over_ipv6.ok()) GTEST_SKIP() << "this machine has no IPv6";
  for (const char* host : {"[::1]", "[::]"}) {
    EXPECT_THAT(CheckHealth(absl::StrCat(host, ":", (*over_ipv6)->port()), absl::Seconds(10)), IsOk());
  }
}

TEST(HealthCheckTest, AServerThatIsSilentIsNotHealthy) {
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  ASSERT_EQ(listen(listener, 1), 0);
  socklen_t size = sizeof(address);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  EXPECT_THAT(CheckHealth(absl::StrCat("127.0.0.1:", ntohs(address.sin_port)), absl::Milliseconds(20)),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("does not answer")));
  close(listener);
}

TEST(HealthCheckTest, AnAddressNeedsAPort) {
  for (const char* address : {"", "localhost", "0.0.0.0:0", "host:port", "host:-1"}) {
    EXPECT_THAT(CheckHealth(address, absl::Seconds(1)),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("metrics_listen")))
        << address;
  }
}

TEST_F(HttpEndpointTest, APortInUseIsAnError) {
  EXPECT_THAT(StartHttpEndpoint(absl::StrCat("127.0.0.1:", endpoint_->port()), nullptr, nullptr),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("cannot listen on")));
}

}  // namespace
}  // namespace holdfast
