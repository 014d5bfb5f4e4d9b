// SPDX-License-Identifier: Apache-2.0
#include "api/address.h"

#include <gtest/gtest.h>

#include <tuple>
#include <vector>

namespace holdfast {
namespace {

TEST(AddressTest, KnowsWhatCrossesNoNetwork) {
  for (const char* address : {"127.0.0.1:50051", "127.0.1.1:0", "localhost:1", "[::1]:50051", "dns:///localhost:1"}) {
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address : {"[::]:50051", "0.0.0.0:50051", "10.0.0.7:50051", "localhost.example:1", "127.example:1",
                              "127.0.0.1.example:1", "dns:///track:1", ""}) {
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

TEST(AddressTest, SplitsIntoHostAndPort) {
  for (const auto& [address, host, port] : std::vector<std::tuple<const char*, const char*, int>>{
           {"localhost:1", "localhost", 1}, {"[::1]:65535", "::1", 65535}, {":0", "", 0}, {"[::]:80", "::", 80}}) {
    const auto parts = SplitHostPort(address);
    ASSERT_TRUE(parts) << address;
    EXPECT_EQ(parts->host, host);
    EXPECT_EQ(parts->port, port);
  }
  for (const char* address : {"", "localhost", "host:port", "host:-1", "host:65536", "host:", "[::1:80", "[::1]"}) {
    EXPECT_FALSE(SplitHostPort(address)) << address;
  }
}

TEST(AddressTest, KnowsPortsThatAreTooLarge) {
  for (const char* address : {"localhost:65536", "[::1]:70000", "dns:///host:99999", "ipv4:127.0.0.1:70000",
                              "ipv6:[::1]:70000", "host:99999999999999999999"}) {
    EXPECT_TRUE(PortIsTooLarge(address)) << address;
  }
  for (const char* address : {"localhost:65535", "[::1]:0", "dns:///host:1", "ipv6:[2001:db8::9999]", "host:https",
                              "unix:/tmp/a:70000", "host:", ""}) {
    EXPECT_FALSE(PortIsTooLarge(address)) << address;
  }
}

}  // namespace
}  // namespace holdfast
