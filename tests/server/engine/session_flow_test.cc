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
  const std::vector<PointRun> runs = flow.TakeLive(/*newest=*/1);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].first_frame, 0);
  EXPECT_EQ(runs[0].x.size(), 1u) << "the removed one speaks of frame 0 alone";
  EXPECT_EQ(runs[1].first_frame, 1);
  EXPECT_EQ(runs[1].x.at(0), 70);
}

TEST(SessionFlowTest, OfFramesWhosePointsAreNotKnownYetNothingIsReported) {
  SessionFlow::Options options;
  options.live = true;
  SessionFlow flow(options);
  flow.SetGeometry(FrameGeometry(kPicture, kPicture, /*stride=*/1), SessionFlow::Scale());
  flow.Apply({{PointOp::Kind::kSeed, /*frame=*/0, PointQuery{7, 40.5f, 50.25f}, /*serial=*/1}});
  for (int64_t frame = 0; frame < 3; ++frame) flow.AddFrame(frame, PictureAt(frame));
  while (flow.Step()) {
  }
  EXPECT_EQ(flow.TakeLive(/*newest=*/0).at(0).x.size(), 1u);
  flow.Apply({{PointOp::Kind::kRemove, /*frame=*/1, PointQuery{7}}});
  const std::vector<PointRun> runs = flow.TakeLive(/*newest=*/2);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].first_frame, 1);
  EXPECT_EQ(runs[0].x.size(), 1u) << "its last frame";
}

// A point of a picture that stands still and then jumps by 40 pixels, which flow cannot follow.
class JumpTest : public ::testing::Test {
 protected:
  static constexpr ImageSize kWorld{256, 192};
  static constexpr float kJump = 40;
  static constexpr int64_t kUntil = 3;  // of the first window
  static constexpr int64_t kJumped = 2;

  JumpTest() : flow_(Options()) {
    Begin(flow_);
    flow_.Apply({kSeed});
  }
  static inline const PointOp kSeed{PointOp::Kind::kSeed, /*frame=*/0, PointQuery{7, 100, 90}, /*serial=*/1};

  static void Begin(SessionFlow& flow) {
    flow.SetGeometry(FrameGeometry(kWorld, kWorld, /*stride=*/1), SessionFlow::Scale());
    AddFrames(0, 0, flow);
  }
  static SessionFlow::Options Options() {
    SessionFlow::Options options;
    options.window_frames = kUntil + 1;
    return options;
  }
  static void AddFrames(int64_t first, int64_t last, SessionFlow& flow) {
    for (int64_t frame = first; frame <= last; ++frame) {
      flow.AddFrame(frame, std::make_shared<FlowPyramid>(RichTexture(kWorld, frame < kJumped ? 0 : kJump, 0)));
    }
  }
  static void Work(SessionFlow& flow) {
    while (flow.Step() || flow.Search()) {
    }
  }
  static std::vector<float> StartsX(const SessionFlow& flow, int64_t last) {
    std::vector<float> x;
    for (const Position& start : flow.Starts(1, last)) x.push_back(start.x);
    return x;
  }
  SessionFlow flow_;
};

TEST_F(JumpTest, APointThatFlowLostIsFoundWhereItsWindowEnds) {
  AddFrames(1, kUntil, flow_);
  Work(flow_);
  ASSERT_TRUE(flow_.Reaches(1, kUntil));
  const std::vector<float> x = StartsX(flow_, kUntil);
  EXPECT_NEAR(x[0], 100, 0.2f) << "from there back flow cannot follow either";
  EXPECT_NEAR(x[1], 100 + kJump, 0.2f);
  EXPECT_NEAR(x[2], 100 + kJump, 0.2f);
}

TEST_F(JumpTest, AWindowWaitsForTheSearchButOneThatEndsEarlierDoesNot) {
  AddFrames(1, kUntil, flow_);
  while (flow_.Step()) {
  }
  EXPECT_FALSE(flow_.Reaches(1, kUntil));
  EXPECT_TRUE(flow_.Reaches(1, kJumped));
  EXPECT_TRUE(flow_.Search());
  EXPECT_TRUE(flow_.Reaches(1, kUntil));
  EXPECT_FALSE(flow_.Search());
}

// Whether the point was looked for before it was known to end depends on the pace.
TEST_F(JumpTest, AWindowThatEndsEarlierStartsFromWhatWasKnownWithoutASearch) {
  AddFrames(1, kUntil, flow_);
  Work(flow_);
  SessionFlow in_time(Options());
  Begin(in_time);
  in_time.Apply({kSeed, {PointOp::Kind::kRemove, kJumped, PointQuery{7}}});
  AddFrames(1, kUntil, in_time);
  Work(in_time);
  ASSERT_TRUE(in_time.Reaches(1, kJumped));
  EXPECT_FALSE(in_time.Reaches(1, kUntil));
  EXPECT_EQ(StartsX(flow_, kJumped), StartsX(in_time, kJumped));
  EXPECT_NEAR(StartsX(flow_, kJumped)[1], 100, 0.2f);
}

TEST_F(JumpTest, WhatNobodyWantsToLookForStaysWhereFlowLeftIt) {
  flow_.Rebase({{/*serial=*/1, /*frame=*/0, {100, 90}, /*confidence=*/1, /*assurance=*/1, /*search=*/false, kUntil}});
  AddFrames(1, kUntil, flow_);
  Work(flow_);
  EXPECT_NEAR(StartsX(flow_, kUntil)[2], 100, 0.2f);
}

TEST_F(JumpTest, APointThatWasInDoubtBeforeIsLookedForThoughFlowHeldIt) {
  AddFrames(1, 1, flow_);
  for (const float assurance : {0.5f, 0.9f}) {
    flow_.Rebase({{/*serial=*/1, /*frame=*/0, {100 - kJump, 90}, /*confidence=*/1, assurance, true, /*until=*/1}});
    Work(flow_);
    EXPECT_NEAR(StartsX(flow_, 1)[0], assurance < 0.6f ? 100 : 100 - kJump, 0.3f);
  }
}

TEST(SessionFlowTest, NothingIsCarriedThatNobodyReads) {
  SessionFlow::Options options;
  options.starts = false;  // patches alone, for polish
  SessionFlow flow(options);
  flow.SetGeometry(FrameGeometry(kPicture, kPicture, /*stride=*/1), SessionFlow::Scale());
  flow.AddFrame(0, PictureAt(0));
  flow.Apply({{PointOp::Kind::kSeed, /*frame=*/0, PointQuery{7, 40.5f, 50.25f}, /*serial=*/1}});
  flow.AddFrame(1, PictureAt(1));
  EXPECT_FALSE(flow.Step());
  EXPECT_NE(flow.PatchOf(1), nullptr);
}

}  // namespace
}  // namespace holdfast
