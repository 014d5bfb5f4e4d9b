// SPDX-License-Identifier: Apache-2.0
#include "api/address.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace holdfast
