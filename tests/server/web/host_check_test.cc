// SPDX-License-Identifier: Apache-2.0
#include "server/web/host_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

constexpr char kListed[] = "https://tracks.example";

TEST(HostCheckTest, ThePageOfThisMachineIsLetIn) {
  for (const std::string host : {"localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"}) {
    EXPECT_THAT(CheckHost({}, host, "http://" + host), IsOk()) << host;
    EXPECT_THAT(CheckHost({}, host, ""), IsOk()) << host;
  }
}

TEST(HostCheckTest, AnotherSitesPageIsNot) {
  for (const std::string origin : {"http://evil.example", "http://localhost:9999", "null",
                                   "https://localhost:8080.evil.example", "localhost:8080"}) {
    EXPECT_THAT(CheckHost({}, "localhost:8080", origin),
                StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("origin is '" + origin)));
  }
}

// A site may have its own name point to 127.0.0.1 once its page is loaded: the browser then thinks the page our own.
TEST(HostCheckTest, ANameThatIsNotThisMachinesIsRefusedWhereNobodyElseCanCall) {
  for (const std::string host : {"evil.example", "localhost.evil.example:8080", "127.evil.example",
                                 "127.0.0.1.evil.example:8080", "128.0.0.1:8080", ""}) {
    EXPECT_THAT(CheckHost({}, host, "http://" + host),
                StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("host is '" + host)));
    EXPECT_THAT(CheckHost({}, host, ""), StatusIs(absl::StatusCode::kPermissionDenied));
  }
}

TEST(HostCheckTest, AServerOfANetworkGoesByEveryName) {
  HostRules rules;
  rules.loopback = false;
  EXPECT_THAT(CheckHost(rules, "box.lan:8080", "http://box.lan:8080"), IsOk());
  EXPECT_THAT(CheckHost(rules, "BOX.lan:8080", "http://box.lan:8080"), IsOk());
  EXPECT_THAT(CheckHost(rules, "box.lan:8080", "http://evil.example"), StatusIs(absl::StatusCode::kPermissionDenied));
}

TEST(HostCheckTest, ListedOriginsAreLetIn) {
  HostRules rules;
  rules.origins = {kListed};
  EXPECT_THAT(CheckHost(rules, "localhost:8080", kListed), IsOk());         // a page that was loaded elsewhere
  EXPECT_THAT(CheckHost(rules, "tracks.example", kListed), IsOk());         // behind a proxy of that name
  EXPECT_THAT(CheckHost(rules, "localhost:8080", "http://tracks.example"),  // no TLS
              StatusIs(absl::StatusCode::kPermissionDenied));
}

// Proxies differ in whether they pass a port on that is the scheme's own, or any.
TEST(HostCheckTest, AHostMayHaveThePortOfItsScheme) {
  HostRules rules;
  rules.loopback = false;
  EXPECT_THAT(CheckHost(rules, "box.lan:443", "https://box.lan"), IsOk());
  EXPECT_THAT(CheckHost(rules, "box.lan:80", "http://box.lan"), IsOk());
  EXPECT_THAT(CheckHost(rules, "box.lan:443", "http://box.lan"), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(CheckHost(rules, ":443", "https://"), StatusIs(absl::StatusCode::kPermissionDenied));
}

TEST(HostCheckTest, AListedOriginOfAnotherPortIsNamedWithAndWithoutIt) {
  HostRules rules;
  rules.origins = {"https://tracks.example:8443", "https://[2001:db8::1]:8443"};
  for (const std::string host : {"tracks.example:8443", "Tracks.example", "[2001:db8::1]:8443", "[2001:db8::1]"}) {
    EXPECT_THAT(CheckHost(rules, host, ""), IsOk()) << host;
    EXPECT_THAT(CheckHost(rules, host, rules.origins[0]), IsOk()) << host;
  }
  EXPECT_THAT(CheckHost(rules, "evil.example:8443", ""), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(CheckHost(rules, "", ""), StatusIs(absl::StatusCode::kPermissionDenied));
}

TEST(HostCheckTest, OriginsAreTakenAsBrowsersNameThem) {
  for (const char* origin :
       {"https://tracks.example", "http://tracks.example", "https://tracks.example:8443", "http://box.lan:8080",
        "https://tracks.example:80", "http://127.0.0.1:8080", "http://[2001:db8::1]", "http://[::1]:8080",
        "https://xn--mnchen-3ya.example", "moz-extension://0a1b"}) {
    EXPECT_TRUE(IsOrigin(origin)) << origin;
  }
  for (const char* origin : {"",
                             "null",
                             "*",
                             "tracks.example",
                             "https://",
                             "://tracks.example",
                             "https://tracks.example/",
                             "https://tracks.example/page",
                             "https://Tracks.Example",
                             "HTTPS://tracks.example",
                             "https://tracks.example:443",
                             "http://tracks.example:80",
                             "https://tracks.example:",
                             "https://tracks.example:08443",
                             "https://tracks.example:65536",
                             "https://tracks.example:0",
                             "https://tracks.example:port",
                             "https://*.example",
                             "https://a b",
                             " https://tracks.example",
                             "https://user@tracks.example",
                             "https://::1",
                             "https://[::1",
                             "https://m\xc3\xbcnchen.example"}) {
    EXPECT_FALSE(IsOrigin(origin)) << origin;
  }
}

}  // namespace
}  // namespace holdfast
