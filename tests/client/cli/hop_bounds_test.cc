// SPDX-License-Identifier: Apache-2.0
#include "client/cli/hop_bounds.h"

#include <gtest/gtest.h>

#include <string>
#include <tuple>

namespace holdfast {
namespace {

TEST(HopBoundsTest, AreANumberTwoOrLeftToTheServer) {
  for (const auto& [text, least, most] :
       {std::tuple{"0", 0, 0}, {"8", 8, 0}, {"4..16", 4, 16}, {"0..12", 0, 12}, {"auto", 0, HopBounds::kAutoMost}}) {
    HopBounds bounds{1, 2};
    std::string error;
    ASSERT_TRUE(AbslParseFlag(text, &bounds, &error)) << text;
    EXPECT_EQ(bounds.least, least) << text;
    EXPECT_EQ(bounds.most, most) << text;
    EXPECT_EQ(AbslUnparseFlag(bounds), text);
  }
}

TEST(HopBoundsTest, OthersAreRefused) {
  for (const char* text : {"", "-1", "few", "4..", "..4", "8..4", "4..8..9", "4-8", "0..0"}) {
    HopBounds bounds;
    std::string error;
    EXPECT_FALSE(AbslParseFlag(text, &bounds, &error)) << text;
    EXPECT_EQ(error, "expected a number of frames, two of them such as 4..16, or auto");
  }
}

}  // namespace
}  // namespace holdfast
