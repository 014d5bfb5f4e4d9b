// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_flow.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

FlowPyramidPtr PictureAt(int64_t frame) {
  return std::make_shared<FlowPyramid>(ShiftedTexture(kPicture, 3.0f * static_cast<float>(frame), 0));
}

TEST(SessionFlowTest, TheSurroundingsOfAQueryAreThoseOfItsFrameHoweverLateTheyAreAskedFor) {
  const FlowPyramidPtr first = PictureAt(0);
  for (const bool worked : {false, true}) {
    SessionFlow flow(SessionFlow::Options{});
    flow.SetGeometry(FrameGeometry(kPicture, kPicture, /*stride=*/1), SessionFlow::Scale());
    flow.AddFrame(0, first);
    flow.Apply({{PointOp::Kind::kSeed, /*frame=*/0, PointQuery{7, 40.5f, 50.25f}, /*serial=*/1}});
    while (worked && flow.Step()) {
    }
    flow.AddFrame(1, PictureAt(1));
    flow.EvictBefore(1);
    const auto patch = flow.PatchOf(1);
    ASSERT_NE(patch, nullptr);
    EXPECT_EQ(patch->code, CutPatch(*first, {40.5f, 50.25f}).code);
    EXPECT_EQ(flow.PatchOf(2), nullptr);
  }
}

TEST(SessionFlowTest, AFrameAtWhichAPointIsRemovedAndAddedAgainIsTheNewOnes) {
  SessionFlow::Options options;
  options.live = true;
  SessionFlow flow(options);
  flow.SetGeometry(FrameGeometry(kPicture, kPicture, /*stride=*/1), SessionFlow::Scale());
  flow.Apply({{PointOp::Kind::kSeed, /*frame=*/0, PointQuery{7, 40.5f, 50.25f}, /*serial=*/1},
              {PointOp::Kind::kRemove, /*frame=*/1, PointQuery{7}},
              {PointOp::Kind::kSeed, /*frame=*/1, PointQuery{7, 70, 30}, /*serial=*/2}});
  for (int64_t frame = 0; frame < 2; ++frame) flow.AddFrame(frame, PictureAt(frame));
  while (flow.Step()) {
  }
  const std::vector<PointRun> runs = flow.TakeLive();
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].first_frame, 0);
  EXPECT_EQ(runs[0].x.size(), 1u) << "the removed one speaks of frame 0 alone";
  EXPECT_EQ(runs[1].first_frame, 1);
  EXPECT_EQ(runs[1].x.at(0), 70);
}

}  // namespace
}  // namespace holdfast
