// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace holdfast {
namespace {

std::vector<int64_t> Wanted(const FrameChoice& choice, int64_t frames) {
  std::vector<int64_t> wanted;
  for (int64_t frame = 0; frame < frames; ++frame) {
    if (choice.Wants(frame)) wanted.push_back(frame);
  }
  return wanted;
}

TEST(FrameChoiceTest, TakesEverySoManyFramesFromTheFirstOnAndThoseThatPointsStartOn) {
  EXPECT_THAT(Wanted(FrameChoice(0, 1, {}), 3), testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(Wanted(FrameChoice(2, 4, {2, 7, 10}), 15), testing::ElementsAre(2, 6, 7, 10, 14));
}

TEST(FrameChoiceTest, NextFramesAndCountsSayTheSame) {
  const FrameChoice choice(2, 4, {2, 7, 10, 19});
  const std::vector<int64_t> wanted = Wanted(choice, 40);
  int64_t next = -1;
  for (const int64_t frame : wanted) {
    EXPECT_EQ(choice.After(next), frame);
    next = frame;
  }
  for (int64_t frames = 0; frames < 40; ++frames) {
    EXPECT_EQ(choice.CountOf(frames), static_cast<int64_t>(Wanted(choice, frames).size())) << frames;
  }
}

}  // namespace
}  // namespace holdfast
