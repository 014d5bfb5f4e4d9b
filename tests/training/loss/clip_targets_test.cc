// SPDX-License-Identifier: Apache-2.0
#include "training/loss/clip_targets.h"

#include <gtest/gtest.h>
#include <torch/types.h>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// Two frames of 16 x 8 pixels with three points.
Sample TwoFrames() {
  Sample sample;
  sample.source = "test";
  for (int s = 0; s < 2; ++s) {
    const cv::Mat wide(8, 20, CV_8UC3, cv::Scalar(s, 10, 20));
    sample.frames.push_back(wide.colRange(2, 18));  // a view: its rows do not follow each other
    sample.masks.emplace_back(8, 16, CV_32SC1, cv::Scalar(s + 1));
  }
  sample.frames[1].at<cv::Vec3b>(3, 5) = {7, 8, 9};
  sample.AllocatePoints(3);
  sample.SetPosition(1, 2, {5, 3});
  sample.valid[sample.At(1, 2)] = sample.visible[sample.At(1, 2)] = 1;
  return sample;
}

TEST(ClipTargetsTest, FramesKeepTheirPixelsAndPointsComeFirst) {
  const auto clip = ToTensors(TwoFrames(), 8);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->frames.sizes(), (std::vector<int64_t>{2, 8, 16, 3}));
  EXPECT_TRUE(torch::equal(clip->frames[1][3][5], torch::tensor({7, 8, 9}, torch::kUInt8)));
  EXPECT_TRUE(torch::equal(clip->frames[1][7][15], torch::tensor({1, 10, 20}, torch::kUInt8)));
  EXPECT_TRUE(torch::equal(clip->targets.tracks[2][1], torch::tensor({5.0f, 3.0f})));
  EXPECT_TRUE(clip->targets.visible[2][1].item<bool>());
  EXPECT_EQ(clip->targets.valid.sum().item<int64_t>(), 1);
  EXPECT_EQ(clip->targets.masks[1][0][0].item<int>(), 2);
}

TEST(ClipTargetsTest, ASourceWithoutMasksHasNone) {
  Sample sample = TwoFrames();
  sample.masks.clear();
  EXPECT_FALSE(ToTensors(sample, 8)->targets.masks.defined());
}

TEST(ClipTargetsTest, RefusesClipsTheNetworkCannotTake) {
  EXPECT_THAT(ToTensors(TwoFrames(), 32), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("16 x 8")));
  Sample sample = TwoFrames();
  sample.SelectPoints({});
  EXPECT_THAT(ToTensors(sample, 8), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no points")));
}

}  // namespace
}  // namespace holdfast
