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

}  // namespace
}  // namespace holdfast
