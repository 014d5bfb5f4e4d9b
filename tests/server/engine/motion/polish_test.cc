// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/polish.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Outcome = Evidence::Polish;

constexpr FlowPoint kQuery{60, 60};
constexpr float kStep = 1.5f;  // pixels a frame, to the right

// Frames 0 .. count - 1 of a picture that moves.
std::vector<FlowPyramidPtr> Pictures(int count, uint32_t seed = 1) {
  std::vector<FlowPyramidPtr> pictures;
  for (int i = 0; i < count; ++i) {
    pictures.push_back(
        std::make_shared<FlowPyramid>(ShiftedTexture(kWidePicture, kStep * static_cast<float>(i), 0, seed)));
  }
  return pictures;
}

// Of frames 1 .. count, each 'error' pixels off.
PolishTrack Track(int count, float error) {
  PolishTrack track;
  track.first = 1;
  track.previous = kQuery;
  for (int i = 1; i <= count; ++i) {
    track.positions.push_back({kQuery.x + kStep * static_cast<float>(i) + error, kQuery.y - error / 2});
    track.visible.push_back(1);
  }
  return track;
}

// 'pictures' are those of frames from 'first' on.
void Polish(absl::Span<PolishTrack> tracks, absl::Span<const FlowPyramidPtr> pictures, int64_t first) {
  for (size_t i = 1; i < pictures.size(); ++i) {
    PolishFrame(tracks, first + static_cast<int64_t>(i), *pictures[i - 1], *pictures[i]);
  }
}

void ExpectExact(const PolishTrack& track) {
  for (size_t i = 0; i < track.positions.size(); ++i) {
    EXPECT_NEAR(track.positions[i].x, kQuery.x + kStep * static_cast<float>(i + 1), 0.15f) << "frame " << i + 1;
    EXPECT_NEAR(track.positions[i].y, kQuery.y, 0.15f) << "frame " << i + 1;
  }
}

TEST(PolishTest, MovesEstimatesToWhereThePatchOfTheQueryIs) {
  const auto pictures = Pictures(5);
  PolishTrack track = Track(4, 1.2f);
  track.patch = std::make_shared<FlowPatch>(CutPatch(*pictures[0], kQuery));
  track.previous.reset();
  Polish({&track, 1}, pictures, 0);
  ExpectExact(track);
  EXPECT_THAT(track.outcomes,
              ElementsAre(Outcome::kFromQuery, Outcome::kFromQuery, Outcome::kFromQuery, Outcome::kFromQuery));
}

TEST(PolishTest, FollowsFromTheFrameBeforeWhereThePatchIsNotFound) {
  const auto pictures = Pictures(5);
  PolishTrack track = Track(4, 1.2f);
  track.patch =
      std::make_shared<FlowPatch>(CutPatch(FlowPyramid(ShiftedTexture(kWidePicture, 0, 0, /*seed=*/7)), kQuery));
  Polish({&track, 1}, pictures, 0);
  ExpectExact(track);
  EXPECT_THAT(track.outcomes,
              ElementsAre(Outcome::kFromBefore, Outcome::kFromBefore, Outcome::kFromBefore, Outcome::kFromBefore));
}

TEST(PolishTest, WhatTurnsDoesNotDrift) {
  PolishTrack track = Track(0, 0);
  std::vector<FlowPyramidPtr> pictures;
  for (int i = 0; i <= 20; ++i) {
    const Deformation turned = Turned(static_cast<float>(i) * 0.1f);  // by 115 degrees in all
    pictures.push_back(std::make_shared<FlowPyramid>(DeformedTexture(kWidePicture, kQuery, kQuery, turned)));
    if (i == 0) continue;
    track.positions.push_back({kQuery.x + (i % 2 == 0 ? 1.5f : -1.5f), kQuery.y});
    track.visible.push_back(1);
  }
  track.patch = std::make_shared<FlowPatch>(CutPatch(*pictures[0], kQuery));
  Polish({&track, 1}, pictures, 0);
  EXPECT_THAT(track.outcomes, Each(Outcome::kFromQuery));
  for (const FlowPoint& position : track.positions) {
    EXPECT_NEAR(position.x, kQuery.x, 0.1f);
    EXPECT_NEAR(position.y, kQuery.y, 0.1f);
  }
  EXPECT_NEAR(track.deformation.xx, std::cos(2.0f), 0.03f);
  EXPECT_NEAR(track.deformation.yx, std::sin(2.0f), 0.03f);
}

TEST(PolishTest, LeavesHiddenOnesAloneAndDoesNotFollowFromThem) {
  const auto pictures = Pictures(4);
  PolishTrack track = Track(3, 1.2f);
  track.visible = {1, 0, 1};
  Polish({&track, 1}, pictures, 0);  // without a patch only the way from the frame before is left
  EXPECT_NEAR(track.positions[0].x, kQuery.x + kStep, 0.15f);
  EXPECT_EQ(track.positions[1].x, kQuery.x + 2 * kStep + 1.2f);
  EXPECT_EQ(track.positions[2].x, kQuery.x + 3 * kStep + 1.2f);
  EXPECT_THAT(track.outcomes, ElementsAre(Outcome::kFromBefore, Outcome::kNotTried, Outcome::kNotFound));
}

TEST(PolishTest, LeavesAnEstimateThatIsFarFromAnythingAlike) {
  auto pictures = Pictures(2);
  PolishTrack track = Track(1, 0);
  track.patch = std::make_shared<FlowPatch>(CutPatch(*pictures[0], kQuery));
  pictures[1] = std::make_shared<FlowPyramid>(ShiftedTexture(kWidePicture, 0, 0, /*seed=*/7));
  const FlowPoint estimate = track.positions[0];
  Polish({&track, 1}, pictures, 0);
  EXPECT_EQ(track.positions[0].x, estimate.x);
  EXPECT_EQ(track.positions[0].y, estimate.y);
  EXPECT_THAT(track.outcomes, ElementsAre(Outcome::kNotFound));
}

TEST(PolishTest, WhereNothingIsKnownToLookForNothingIsFound) {
  const auto pictures = Pictures(2);
  PolishTrack track = Track(1, 0);
  track.previous.reset();
  Polish({&track, 1}, pictures, 0);
  EXPECT_THAT(track.outcomes, ElementsAre(Outcome::kNotFound));
}

TEST(PolishTest, WhatTheQueryBridgesAfterAHiddenFrameIsFoundFromIt) {
  const auto pictures = Pictures(4);
  PolishTrack track = Track(3, 1.2f);
  track.patch = std::make_shared<FlowPatch>(CutPatch(*pictures[0], kQuery));
  track.visible = {1, 0, 1};
  Polish({&track, 1}, pictures, 0);
  EXPECT_THAT(track.outcomes, ElementsAre(Outcome::kFromQuery, Outcome::kNotTried, Outcome::kFromQuery));
}

TEST(PolishTest, FramesThatWereNotPolishedHaveNoOutcome) {
  const auto pictures = Pictures(3);
  PolishTrack tracks[] = {Track(6, 0.9f), Track(6, 0.9f)};
  tracks[1].first = 10;
  Polish(absl::MakeSpan(tracks), pictures, 0);  // up to frame 2
  EXPECT_THAT(tracks[0].outcomes, SizeIs(2));
  EXPECT_THAT(tracks[0].outcomes, Each(Outcome::kFromBefore));
  EXPECT_THAT(tracks[1].outcomes, IsEmpty());
}

TEST(PolishTest, InPiecesAndBesideOthersItIsTheSameToTheBit) {
  const auto pictures = Pictures(7);
  const auto make = [&](int frames) {
    PolishTrack track = Track(frames, 0.9f);
    track.patch = std::make_shared<FlowPatch>(CutPatch(*pictures[0], kQuery));
    return track;
  };
  PolishTrack whole = make(6);
  Polish({&whole, 1}, pictures, 0);
  std::vector<PolishTrack> crowd;
  for (int i = 0; i < 40; ++i) {
    crowd.push_back(Track(1 + i % 6, 0.1f * static_cast<float>(i)));
  }
  crowd.insert(crowd.begin() + 20, make(6));
  Polish(absl::MakeSpan(crowd), pictures, 0);
  PolishTrack first = make(3), second = make(6);
  Polish({&first, 1}, absl::MakeConstSpan(pictures).subspan(0, 4), 0);
  second.first = 4;
  second.positions.erase(second.positions.begin(), second.positions.begin() + 3);
  second.visible.resize(3);
  second.previous = first.positions.back();
  second.deformation = first.deformation;
  Polish({&second, 1}, absl::MakeConstSpan(pictures).subspan(3), 3);
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(whole.positions[i].x, crowd[20].positions[i].x);
    EXPECT_EQ(whole.positions[i].x, (i < 3 ? first.positions[i] : second.positions[i - 3]).x);
    EXPECT_EQ(whole.outcomes[i], crowd[20].outcomes[i]);
    EXPECT_EQ(whole.outcomes[i], (i < 3 ? first.outcomes[i] : second.outcomes[i - 3]));
  }
}

}  // namespace
}  // namespace holdfast
