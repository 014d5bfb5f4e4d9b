// SPDX-License-Identifier: Apache-2.0
#include "training/loss/window_plan.h"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <cmath>

namespace holdfast {
namespace {

// Points at (100 n + 2 t, 50).
ClipTargets Moving(int64_t points, int64_t frames) {
  ClipTargets targets;
  const torch::Tensor x = torch::arange(points).view({-1, 1}) * 100 + torch::arange(frames) * 2;
  targets.tracks = torch::stack({x, torch::full_like(x, 50)}, -1).to(torch::kFloat32);
  targets.visible = torch::ones({points, frames}, torch::kBool);
  targets.valid = targets.visible.clone();
  return targets;
}

torch::Tensor Queries(const torch::Tensor& start) { return start.select(1, 0); }

TEST(WindowPlanTest, StartsWithZeroVelocityWhenNoNoiseIsAskedFor) {
  const ClipTargets targets = Moving(3, 6);
  Rng rng(1);
  const ClipWindowPlan plan = PlanWindow(targets, 64, {0, 0}, rng);
  EXPECT_EQ(plan.distinct_frames, 6);
  EXPECT_TRUE(torch::equal(plan.start, targets.tracks.narrow(1, 0, 1).expand({3, 6, 2})));
}

TEST(WindowPlanTest, EveryStartBeginsExactlyAtTheQuery) {
  const ClipTargets targets = Moving(3, 6);
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    const ClipWindowPlan plan = PlanWindow(targets, 64, {0.5, 0.5}, rng);
    EXPECT_TRUE(torch::equal(Queries(plan.start), Queries(targets.tracks)));
    EXPECT_TRUE(torch::isfinite(plan.start).all().item<bool>());
    EXPECT_GE(plan.distinct_frames, 2);
    EXPECT_LE(plan.distinct_frames, 6);
  }
}

TEST(WindowPlanTest, TheSameSeedGivesTheSamePlan) {
  const ClipTargets targets = Moving(3, 6);
  Rng a(7), b(7), c(8);
  const torch::Tensor first = PlanWindow(targets, 64, {1, 0}, a).start;
  EXPECT_TRUE(torch::equal(first, PlanWindow(targets, 64, {1, 0}, b).start));
  EXPECT_FALSE(torch::equal(first, PlanWindow(targets, 64, {1, 0}, c).start));
}

TEST(WindowPlanTest, NoiseIsMixedWithTheTruthInAShareOfItsOwnForEachPoint) {
  const ClipTargets targets = Moving(200, 24);
  Rng rng(3);
  const torch::Tensor start = NoisyStart(targets, 100, rng);
  const torch::Tensor error = (start - targets.tracks).norm(2, -1).mean(1);  // [200]
  EXPECT_LT(error.min().item<float>(), 2);                                   // nearly the truth
  EXPECT_GT(error.max().item<float>(), 20);                                  // nearly noise
}

TEST(WindowPlanTest, NoiseDoesNotFollowLabelsThatAreNotValid) {
  ClipTargets targets = Moving(4, 6);
  targets.tracks.narrow(1, 3, 3).fill_(1e9);
  targets.valid.narrow(1, 3, 3).fill_(false);
  Rng rng(4);
  EXPECT_LT(NoisyStart(targets, 64, rng).abs().max().item<float>(), 1e4);
  EXPECT_LT(ContinuedStart(targets, 6, rng).abs().max().item<float>(), 1e4);
}

TEST(WindowPlanTest, AStartStaysAtTheLastPositionKnownWhereALabelIsNotValid) {
  ClipTargets targets = Moving(3, 24);
  targets.tracks.mul_(10);
  const torch::Tensor want = targets.tracks.clone();
  want.narrow(1, 11, 3).copy_(want.narrow(1, 10, 1));
  targets.tracks.narrow(1, 11, 3).fill_(1e9);
  targets.valid.narrow(1, 11, 3).fill_(false);
  Rng rng(5);
  EXPECT_LT((ContinuedStart(targets, 24, rng) - want).abs().max().item<float>(), 6);
}

TEST(WindowPlanTest, AContinuationKnowsTheFirstFramesAndRepeatsTheLastOfThem) {
  const ClipTargets targets = Moving(3, 8);
  Rng rng(5);
  const torch::Tensor start = ContinuedStart(targets, 4, rng);
  EXPECT_LT((start - targets.tracks).narrow(1, 0, 4).abs().max().item<float>(), 6);
  for (int64_t t = 4; t < 8; ++t) EXPECT_TRUE(torch::equal(start.select(1, t), start.select(1, 3)));
}

TEST(WindowPlanTest, AChainGoesOnFromWhatIsKnownAndFollowsTheTruthUntilItFails) {
  const ClipTargets targets = Moving(400, 24);
  Rng rng(6);
  const torch::Tensor start = ZeroVelocity(targets.tracks);
  const torch::Tensor chain = ChainedStart(start, targets, 1, 256, rng);
  EXPECT_TRUE(torch::equal(Queries(chain), Queries(targets.tracks)));
  const torch::Tensor error = (chain - targets.tracks).norm(2, -1);  // [400, 24]
  const float followed = (error.select(1, 23) < 8).to(torch::kFloat32).mean().item<float>();
  EXPECT_NEAR(followed, std::pow(0.98, 23), 0.12);  // some of those that failed come by again
  EXPECT_GT(error.select(1, 23).max().item<float>(), 30);
  EXPECT_LT(error.select(1, 1).median().item<float>(), 1);
}

TEST(WindowPlanTest, AChainIsLostWhereThePointIsHidden) {
  ClipTargets targets = Moving(400, 24);
  targets.visible.narrow(1, 4, 12).fill_(false);
  Rng rng(7);
  const torch::Tensor chain = ChainedStart(ZeroVelocity(targets.tracks), targets, 1, 256, rng);
  const torch::Tensor error = (chain - targets.tracks).norm(2, -1);
  EXPECT_LT((error.select(1, 23) < 3).to(torch::kFloat32).mean().item<float>(), 0.1);
}

TEST(WindowPlanTest, AChainKeepsWhatIsKnownAndDoesNotFollowLabelsThatAreNotValid) {
  ClipTargets targets = Moving(4, 8);
  targets.tracks.narrow(1, 5, 3).fill_(1e9);
  targets.valid.narrow(1, 5, 3).fill_(false);
  Rng rng(8);
  const torch::Tensor known = ContinuedStart(targets, 4, rng);
  const torch::Tensor chain = ChainedStart(known, targets, 4, 64, rng);
  EXPECT_TRUE(torch::equal(chain.narrow(1, 0, 4), known.narrow(1, 0, 4)));
  EXPECT_LT(chain.abs().max().item<float>(), 1e4);
  EXPECT_TRUE(torch::equal(ChainedStart(known, targets, 8, 64, rng), known));
}

TEST(WindowPlanTest, ARepeatedTailHasAStartThatRepeatsToo) {
  const ClipTargets targets = Moving(3, 8);
  Rng rng(9);
  for (int i = 0; i < 50; ++i) {
    const ClipWindowPlan plan = PlanWindow(targets, 64, {0, 1, 1}, rng);
    for (int64_t t = plan.distinct_frames; t < 8; ++t) {
      EXPECT_TRUE(torch::equal(plan.start.select(1, t), plan.start.select(1, plan.distinct_frames - 1)));
    }
  }
}

TEST(WindowPlanTest, ARepeatedTailRepeatsItsLabelsAndMasks) {
  ClipTargets targets = Moving(2, 4);
  targets.masks = torch::arange(4, torch::kInt32).view({4, 1, 1});
  targets.visible[0][1] = false;
  const ClipTargets repeated = RepeatTail(targets, 2);
  EXPECT_TRUE(torch::equal(repeated.masks.flatten(), torch::tensor({0, 1, 1, 1}, torch::kInt32)));
  EXPECT_TRUE(torch::equal(repeated.tracks.select(1, 3), targets.tracks.select(1, 1)));
  EXPECT_TRUE(torch::equal(repeated.visible[0], torch::tensor({true, false, false, false})));
}

}  // namespace
}  // namespace holdfast
