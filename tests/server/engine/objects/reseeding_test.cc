// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/reseeding.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::Ge;
using ::testing::IsEmpty;
using ::testing::Le;
using ::testing::SizeIs;

constexpr ObjectId kObjectId = 5;
constexpr int64_t kMeeting = 18, kCovered = 33;

// 16 points on a square of 40 pixels around (50, 50), which has moved by (8, 0).
ObjectState Sixteen() {
  ObjectState state;
  state.id = kObjectId;
  state.query_frame = 10;
  state.next = kMeeting;
  state.shape = {{50, 50}, 40, {{30, 30}, {70, 30}, {70, 70}, {30, 70}}};
  state.judgement.motion.tx = 8;
  for (uint32_t i = 0; i < 16; ++i) {
    ObjectMember& member = state.members.emplace_back();
    member.id = ObjectPointId(kObjectId, i);
    member.home = {35.0f + 10.0f * static_cast<float>(i % 4), 35.0f + 10.0f * static_cast<float>(i / 4)};
    member.queried = state.query_frame;
    member.final_before = kMeeting + 1;
    member.samples = {{{member.home.x + 8, member.home.y}, true}};
  }
  state.judgement.standings.resize(16);
  return state;
}

void Leave(ObjectState& state, std::vector<size_t> members) {
  for (const size_t i : members) state.judgement.standings[i].left = true;
}

TEST(ReseedingTest, PointsThatHaveLeftAreToBePlacedWhereTheyBelong) {
  ObjectState state = Sixteen();
  Leave(state, {5, 10});
  const Reseeding found = FindReseeding(state, kCovered);
  EXPECT_EQ(found.frame, kMeeting);
  EXPECT_THAT(found.lost, ElementsAre(ObjectPointId(kObjectId, 5), ObjectPointId(kObjectId, 10)));
  EXPECT_EQ(found.belong[0].x, 53);
  EXPECT_EQ(found.belong[0].y, 45);
  EXPECT_THAT(found.kept, SizeIs(14));
  EXPECT_EQ(found.outline[1].x, 78);
  EXPECT_EQ(found.spacing, 10);
}

TEST(ReseedingTest, NobodyIsLostWhoMayComeBack) {
  ObjectState state = Sixteen();
  Leave(state, {5});
  state.judgement.standings[5].contrary = 2;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty());
}

TEST(ReseedingTest, AtMostAQuarterAtATime) {
  ObjectState state = Sixteen();
  Leave(state, {0, 3, 6, 9, 12, 15});
  EXPECT_THAT(FindReseeding(state, kCovered).lost, SizeIs(4));
}

TEST(ReseedingTest, HalfOfThePointsHaveToHold) {
  ObjectState state = Sixteen();
  Leave(state, {5});
  for (const size_t hidden : {3, 7, 11, 12, 13, 14, 15}) state.members[hidden].samples[0].visible = false;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, SizeIs(1));
  state.members[2].samples[0].visible = false;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty());
}

TEST(ReseedingTest, NobodyIsPlacedWhereTheObjectIsHidden) {
  ObjectState state = Sixteen();
  Leave(state, {0});
  for (const size_t near : {1, 4, 5}) state.members[near].samples[0].visible = false;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty());
}

TEST(ReseedingTest, APlaceIsTakenOnce) {
  ObjectState state = Sixteen();
  Leave(state, {5});
  state.members[5].end = kCovered;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty()) << "somebody else follows it, or was removed";
  state.members[5].end = kCovered + 1;  // which may not have been said yet
  EXPECT_THAT(FindReseeding(state, kCovered).lost, SizeIs(1));
  ObjectMember before = state.members[5];
  state.members[5].id = ObjectSuccessor(before.id);
  before.end = kMeeting + 2;
  state.members.push_back(before);
  state.judgement.standings.emplace_back().left = true;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty()) << "the one before it has not ended";
  state.members.back().end = kMeeting + 1;
  EXPECT_THAT(FindReseeding(state, kCovered).lost, ElementsAre(ObjectSuccessor(before.id)));
  state.members[5].id = ObjectPointId(kObjectId, 0xFFFFFF05);
  EXPECT_THAT(FindReseeding(state, kCovered).lost, IsEmpty()) << "there are no ids left";
}

GrayImage NoiseOf(ImageSize size) {
  cv::Mat picture(size.height, size.width, CV_8UC1);
  cv::RNG(3).fill(picture, cv::RNG::UNIFORM, 0, 256);
  return {size, {picture.begin<uint8_t>(), picture.end<uint8_t>()}};
}

TEST(ReseedingTest, PlacesLieNearWhereTheLostOnesBelong) {
  ObjectState state = Sixteen();
  Leave(state, {5, 10});
  const Reseeding found = FindReseeding(state, kCovered);
  for (const ImageSize picture : {ImageSize{120, 100}, ImageSize{60, 100}}) {
    const std::vector<Pixel> places = PlaceAnew(found, NoiseOf(picture), {120, 100});
    ASSERT_THAT(places, SizeIs(2));
    for (const Pixel& belong : found.belong) {
      const auto near = [&](Pixel at) { return std::hypot(at.x - belong.x, at.y - belong.y) <= 6; };
      EXPECT_TRUE(near(places[0]) || near(places[1]));
    }
  }
}

TEST(ReseedingTest, PlacesLieOnTheObjectAndInTheFrame) {
  ObjectState state = Sixteen();
  Leave(state, {12});
  Reseeding found = FindReseeding(state, kCovered);
  found.spacing = 40;
  const std::vector<Pixel> places = PlaceAnew(found, NoiseOf({80, 68}), {80, 68});
  ASSERT_THAT(places, SizeIs(1));
  EXPECT_THAT(places[0].x, Ge(38));
  EXPECT_THAT(places[0].y, Le(67));
  found.belong = {{-500, 20}};
  EXPECT_THAT(PlaceAnew(found, NoiseOf({80, 68}), {80, 68}), IsEmpty());
  found.belong = {{1e30f, -1e30f}};
  EXPECT_THAT(PlaceAnew(found, NoiseOf({80, 68}), {80, 68}), IsEmpty());
}

}  // namespace
}  // namespace holdfast
