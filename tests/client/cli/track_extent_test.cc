// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_extent.h"

#include <gtest/gtest.h>

namespace holdfast {
namespace {

std::string OfAllFrames(const TrackExtent& extent) {
  return Describe(extent, [](int64_t frame) { return frame; });
}

TEST(TrackExtentTest, DescribesWhatIsThereWhatIsFinalAndWhatIsMissing) {
  EXPECT_EQ(OfAllFrames({72, 64, 120, false}), "frames 0..71 of 120 (0..63 are final), 72..119 are missing");
  EXPECT_EQ(OfAllFrames({72, 72, 73, false}), "frames 0..71 of 73 (all final), 72 is missing");
  EXPECT_EQ(OfAllFrames({8, 1, 8, false}), "frames 0..7 of 8 (0 is final), none is missing");
  EXPECT_EQ(OfAllFrames({1, 0, 120, false}), "frame 0 of 120 (none final), 1..119 are missing");
}

TEST(TrackExtentTest, FramesHaveTheNumbersOfTheInput) {
  const auto every_third = [](int64_t frame) { return 100 + 3 * frame; };
  EXPECT_EQ(Describe({4, 3, 6, false}, every_third),
            "frames 100..109, 4 of 6 (100..106 are final), 112..115 are missing");
}

}  // namespace
}  // namespace holdfast
