// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/object_group.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr ObjectId kId = 5;
constexpr int64_t kQuery = 10;

// A square of 40 pixels around (50, 50), and 9 points on it, 10 pixels apart.
ObjectShape Square() {
  ObjectShape shape;
  shape.centre = {50, 50};
  shape.size = 40;
  shape.outline = {{30, 30}, {70, 30}, {70, 70}, {30, 70}};
  return shape;
}

std::vector<PointQuery> Nine() {
  std::vector<PointQuery> points;
  for (uint32_t i = 0; i < 9; ++i) {
    points.push_back(
        {ObjectPointId(kId, i), 40.0f + 10.0f * static_cast<float>(i % 3), 40.0f + 10.0f * static_cast<float>(i / 3)});
  }
  return points;
}

struct Seen {
  Pixel at;
  bool visible = true;
};
// Where point i is, 't' frames after the query.
using World = std::function<Seen(uint32_t i, Pixel home, int64_t t)>;

PointRun RunOf(uint32_t i, const World& world, int64_t begin, int64_t end, int64_t finals) {
  const PointQuery home = Nine()[i];
  PointRun run;
  run.id = home.id;
  run.first_frame = begin;
  run.final_count = finals;
  for (int64_t frame = begin; frame < end; ++frame) {
    const Seen seen = world(i, {home.x, home.y}, frame - kQuery);
    run.x.push_back(seen.at.x);
    run.y.push_back(seen.at.y);
    run.visible.push_back(seen.visible ? 1 : 0);
    run.confidence.push_back(1);
  }
  return run;
}

// Frames begin .. end - 1 of all points, of which the first 'finals' are final.
void AddAll(ObjectGroup& group, const World& world, int64_t begin, int64_t end, int64_t finals) {
  for (uint32_t i = 0; i < 9; ++i) group.Add(RunOf(i, world, begin, end, finals));
}

ObjectRun Final(const World& world, int64_t frames) {
  ObjectGroup group(kId, kQuery, Square(), Nine());
  AddAll(group, world, kQuery, kQuery + frames, frames);
  return group.TakeRun(/*provisional=*/false).value_or(ObjectRun());
}

Seen Shifting(uint32_t /*i*/, Pixel home, int64_t t) { return {{home.x + 2 * static_cast<float>(t), home.y}}; }

// Point 4, in the middle, stays where it was on frame 'from'.
World Losing(int64_t from) {
  return [from](uint32_t i, Pixel home, int64_t t) { return Shifting(i, home, i == 4 ? std::min(t, from) : t); };
}

TEST(ObjectGroupTest, ReportsTheQueryAsItWas) {
  const ObjectRun run = Final(Shifting, 1);
  EXPECT_EQ(run.id, kId);
  EXPECT_EQ(run.first_frame, kQuery);
  EXPECT_EQ(run.final_count, 1);
  ASSERT_THAT(run.samples, SizeIs(1));
  const ObjectSample& sample = run.samples[0];
  EXPECT_EQ(sample.centre.x, 50);
  EXPECT_EQ(sample.scale, 1);
  EXPECT_EQ(sample.rotation, 0);
  EXPECT_EQ(sample.visible, 1);
  EXPECT_EQ(sample.outline[2].y, 70);
  EXPECT_THAT(sample.left, IsEmpty());
}

TEST(ObjectGroupTest, FollowsATurnAndAShift) {
  // A tenth of a radian a frame about (50, 50), and 3 pixels down.
  const ObjectRun run = Final(
      [](uint32_t, Pixel home, int64_t t) -> Seen {
        const double c = std::cos(0.1 * static_cast<double>(t)), s = std::sin(0.1 * static_cast<double>(t));
        const double x = home.x - 50, y = home.y - 50;
        return {{static_cast<float>(50 + c * x - s * y), static_cast<float>(50 + s * x + c * y + 3.0 * t)}};
      },
      11);
  ASSERT_THAT(run.samples, SizeIs(11));
  const ObjectSample& last = run.samples[10];
  EXPECT_NEAR(last.rotation, 1, 1e-4);
  EXPECT_NEAR(last.scale, 1, 1e-4);
  EXPECT_NEAR(last.centre.x, 50, 1e-3);
  EXPECT_NEAR(last.centre.y, 80, 1e-3);
  EXPECT_NEAR(last.outline[0].x, 50 - 20 * std::cos(1) + 20 * std::sin(1), 1e-3);
}

TEST(ObjectGroupTest, APointThatStaysBehindHasLeft) {
  const ObjectRun run = Final(Losing(5), 20);
  ASSERT_THAT(run.samples, SizeIs(20));
  // It may lie 0.15 * 40 = 6 pixels off: 3 frames of 2 pixels. It has left by the third frame beyond that.
  EXPECT_THAT(run.samples[9].left, IsEmpty());
  EXPECT_THAT(run.samples[11].left, ElementsAre(ObjectPointId(kId, 4)));
  EXPECT_THAT(run.samples[19].left, ElementsAre(ObjectPointId(kId, 4)));
  EXPECT_NEAR(run.samples[19].centre.x, 88, 1e-3);
  EXPECT_EQ(run.samples[19].visible, 1);  // all of those that it still has
}

TEST(ObjectGroupTest, TwoFramesAstrayAreForgiven) {
  const ObjectRun run = Final(
      [](uint32_t i, Pixel home, int64_t t) {
        Seen seen = Shifting(i, home, t);
        if (i == 2 && (t == 7 || t == 8)) seen.at.y += 60;
        return seen;
      },
      14);
  for (const ObjectSample& sample : run.samples) EXPECT_THAT(sample.left, IsEmpty());
}

TEST(ObjectGroupTest, APointMayComeBack) {
  const ObjectRun run = Final(
      [](uint32_t i, Pixel home, int64_t t) {
        Seen seen = Shifting(i, home, t);
        if (i == 2 && t >= 5 && t < 10) seen.at.y += 60;
        return seen;
      },
      20);
  EXPECT_THAT(run.samples[9].left, SizeIs(1));
  EXPECT_THAT(run.samples[14].left, SizeIs(1));
  EXPECT_THAT(run.samples[15].left, IsEmpty());
}

TEST(ObjectGroupTest, AHiddenObjectStandsStillAndLosesNobody) {
  const ObjectRun run = Final(
      [](uint32_t i, Pixel home, int64_t t) {
        Seen seen = Shifting(i, home, t);
        if (t >= 5 && t < 10) {
          seen.visible = false;
          seen.at = {7, 7};
        }
        return seen;
      },
      12);
  EXPECT_EQ(run.samples[7].visible, 0);
  EXPECT_NEAR(run.samples[7].centre.x, run.samples[4].centre.x, 1e-4);
  EXPECT_NEAR(run.samples[11].centre.x, 72, 1e-3);
  EXPECT_THAT(run.samples[11].left, IsEmpty());
}

// A textured square of 120 pixels in the left half of a frame of 512 x 384, and 'count' points spread over it.
constexpr float kFrameRight = 511;

ObjectShape LargeSquare() {
  ObjectShape shape;
  shape.centre = {200, 190};
  shape.size = 120;
  shape.outline = {{140, 130}, {260, 130}, {260, 250}, {140, 250}};
  return shape;
}

Pixel HomeOf(uint32_t i, uint32_t count) {
  const auto columns = static_cast<uint32_t>(std::ceil(std::sqrt(count)));
  const float apart = 110.0f / static_cast<float>(columns - 1);
  return {145 + apart * static_cast<float>(i % columns), 135 + apart * static_cast<float>(i / columns)};
}

// Told in one go, or 'piece' frames at a time by groups each of which goes on where the one before was.
std::vector<ObjectSample> FinalOfLargeSquare(uint32_t count, const World& world, int64_t frames, int64_t piece = 1000) {
  std::vector<PointQuery> points;
  for (uint32_t i = 0; i < count; ++i) {
    const Pixel home = HomeOf(i, count);
    points.push_back({ObjectPointId(kId, i), home.x, home.y});
  }
  std::vector<ObjectSample> samples;
  ObjectGroup group(kId, kQuery, LargeSquare(), points);
  for (int64_t begin = 0; begin < frames; begin += piece) {
    for (const PointQuery& point : points) {
      PointRun run;
      run.id = point.id;
      run.first_frame = kQuery + begin;
      run.final_count = std::min(piece, frames - begin);
      for (int64_t t = begin; t < begin + run.final_count; ++t) {
        const Seen seen = world(ObjectPointIndex(point.id), {point.x, point.y}, t);
        run.x.push_back(seen.at.x);
        run.y.push_back(seen.at.y);
        run.visible.push_back(seen.visible ? 1 : 0);
        run.confidence.push_back(1);
      }
      group.Add(run);
    }
    const std::vector<ObjectSample> next = group.TakeRun(/*provisional=*/false).value_or(ObjectRun()).samples;
    samples.insert(samples.end(), next.begin(), next.end());
    group = ObjectGroup(group.StateBefore(kQuery + std::min(begin + piece, frames)));
  }
  return samples;
}

// The furthest that any corner goes from one frame to the next.
double LargestStep(const std::vector<ObjectSample>& samples) {
  double largest = 0;
  for (size_t t = 1; t < samples.size(); ++t) {
    for (size_t i = 0; i < samples[t].outline.size(); ++i) {
      const Pixel a = samples[t - 1].outline[i], b = samples[t].outline[i];
      largest = std::max(largest, std::hypot(double{a.x} - b.x, double{a.y} - b.y));
    }
  }
  return largest;
}

// How often in a thousand an object of 'count' points goes anywhere, of which 'visible' are, at places of a box that is
// 'width' wide and lies where it was.
int MovedByChance(uint32_t count, uint32_t visible, float width) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> x(260 - width, 260), y(130, 250);
  int moved = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto samples = FinalOfLargeSquare(
        count,
        [&](uint32_t point, Pixel home, int64_t t) -> Seen {
          if (t == 0) return {home};
          return {{x(random), y(random)}, point * 5 % count < visible};
        },
        2);
    moved += LargestStep(samples) > 0 ? 1 : 0;
  }
  return moved;
}

TEST(ObjectGroupTest, VotesThatHaveNothingInCommonHardlyEverMoveIt) {
  for (const float width : {120.0f, 30.0f}) {
    for (uint32_t visible = 6; visible <= 10; ++visible) {
      SCOPED_TRACE(testing::Message() << visible << " visible ones over " << width << " pixels");
      EXPECT_LE(MovedByChance(48, visible, width), 20);
      EXPECT_LE(MovedByChance(visible, visible, width), 20) << "of as many";
    }
  }
}

// Half of the points are seen, all around one place, to which a similarity that makes a dot of the object leads them.
TEST(ObjectGroupTest, PointsThatGatherInOnePlaceDoNotShrinkIt) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> x(140, 260), y(130, 250);
  for (const float spread : {3.0f, 5.0f, 7.0f}) {
    std::normal_distribution<float> off(0, spread);
    for (int i = 0; i < 100; ++i) {
      const Pixel place{x(random), y(random)};
      const auto samples = FinalOfLargeSquare(
          24,
          [&](uint32_t point, Pixel home, int64_t t) -> Seen {
            if (t == 0) return {home};
            return {{place.x + off(random), place.y + off(random)}, point % 2 == 0};
          },
          2);
      ASSERT_GT(samples[1].scale, 0.5) << i << " of a spread of " << spread;
    }
  }
}

// It goes to the right by 8 pixels a frame; of the points that are outside every fifth is said to be visible, somewhere
// at the frame's border.
TEST(ObjectGroupTest, AnObjectThatLeavesTheFrameDoesNotJump) {
  for (const uint32_t count : {12, 24, 48, 64}) {
    SCOPED_TRACE(count);
    std::mt19937 random(3);
    std::uniform_real_distribution<float> off(0, 30), y(120, 260);
    const auto samples = FinalOfLargeSquare(
        count,
        [&](uint32_t i, Pixel home, int64_t t) -> Seen {
          const Pixel at{home.x + 8 * static_cast<float>(t), home.y};
          if (at.x <= kFrameRight) return {at};
          return {{kFrameRight - off(random), y(random)}, i % 5 == 0};
        },
        80);
    ASSERT_THAT(samples, SizeIs(80));
    EXPECT_LT(LargestStep(samples), 30) << "a few steps";
    EXPECT_NEAR(samples[35].centre.x, 200 + 8 * 35, 4) << "while most of it is in sight";
    EXPECT_GT(samples[79].centre.x, 480);
    EXPECT_NEAR(samples[79].centre.y, 190, 40);
    EXPECT_NEAR(samples[79].scale, 1, 0.3);
  }
}

TEST(ObjectGroupTest, FewPointsThatAgreeAreFollowedInSmallStepsAlone) {
  for (const float step : {12.0f, 60.0f}) {
    const auto samples = FinalOfLargeSquare(
        48,
        [step](uint32_t i, Pixel home, int64_t t) -> Seen {
          return {{home.x + step * static_cast<float>(t), home.y}, t == 0 || i % 7 == 0};
        },
        4);
    EXPECT_NEAR(samples[3].centre.x, step < 20 ? 200 + 3 * step : 200, 1e-3);
  }
}

TEST(ObjectGroupTest, AnObjectOfFewPointsIsFollowedHoweverFast) {
  for (const uint32_t count : {3, 4, 5}) {
    const auto samples = FinalOfLargeSquare(
        count,
        [](uint32_t, Pixel home, int64_t t) -> Seen {
          return {{home.x + 70 * static_cast<float>(t), home.y}};
        },
        5);
    EXPECT_NEAR(samples[4].centre.x, 480, 1e-3) << count;
  }
}

TEST(ObjectGroupTest, AnObjectOfFewPointsMayLoseOne) {
  for (const uint32_t count : {4, 5, 6}) {
    const auto samples = FinalOfLargeSquare(
        count,
        [](uint32_t i, Pixel home, int64_t t) -> Seen {
          return {{home.x + (i == 0 ? 0 : 10 * static_cast<float>(t)), home.y}};
        },
        20);
    EXPECT_NEAR(samples[19].centre.x, 390, 1e-3) << count;
    EXPECT_THAT(samples[19].left, ElementsAre(ObjectPointId(kId, 0))) << count;
  }
}

bool Same(const ObjectSample& a, const ObjectSample& b) {
  const auto same = [](Pixel p, Pixel q) { return p.x == q.x && p.y == q.y; };
  return same(a.centre, b.centre) && a.scale == b.scale && a.rotation == b.rotation && a.visible == b.visible &&
         a.left == b.left && a.joined == b.joined &&
         std::equal(a.outline.begin(), a.outline.end(), b.outline.begin(), b.outline.end(), same);
}

// Final samples of a group that hears of frames in pieces, provisional estimates among them, that are wrong.
std::vector<ObjectSample> InPieces(const World& world, int64_t frames, int64_t piece, ObjectGroup group) {
  std::vector<ObjectSample> finals;
  const World wrong = [&world](uint32_t i, Pixel home, int64_t t) {
    Seen seen = world(i, home, t);
    seen.at.x += 9.0f * static_cast<float>(i % 4);
    return seen;
  };
  for (int64_t begin = kQuery; begin < kQuery + frames; begin += piece) {
    const int64_t end = std::min(begin + piece, kQuery + frames);
    AddAll(group, wrong, begin, end + 6, 0);
    (void)group.TakeRun(/*provisional=*/true);
    for (const uint32_t i : {8, 1, 3, 2, 0, 7, 4, 5, 6}) {
      group.Add(RunOf(i, world, begin, end, end - begin));
      const auto run = group.TakeRun(/*provisional=*/true);
      if (!run || run->final_count == 0) continue;
      EXPECT_EQ(run->first_frame, kQuery + static_cast<int64_t>(finals.size()));
      finals.insert(finals.end(), run->samples.begin(), run->samples.begin() + run->final_count);
    }
    group = ObjectGroup(group.StateBefore(1000));  // as a session that goes on elsewhere
  }
  return finals;
}

// Most of its points go with something else, which leaves after 40 frames, and take the object with them.
TEST(ObjectGroupTest, ComesBackToThoseThatStayedOnceTheOthersAreGone) {
  const World carried = [](uint32_t i, Pixel home, int64_t t) -> Seen {
    const bool goes = i % 2 == 0 || i == 1;
    return {{home.x + (goes ? 10 * static_cast<float>(t) : 0), home.y}, !goes || t < 40};
  };
  const auto samples = FinalOfLargeSquare(24, carried, 60);
  ASSERT_THAT(samples, SizeIs(60));
  EXPECT_THAT(samples[39].left, SizeIs(11));
  EXPECT_THAT(samples[42].left, SizeIs(11)) << "six frames in a row";
  EXPECT_NEAR(samples[47].centre.x, 200, 1e-3);
  EXPECT_THAT(samples[59].left, IsEmpty());
  for (const int64_t piece : {1, 43}) {
    const auto resumed = FinalOfLargeSquare(24, carried, 60, piece);
    EXPECT_TRUE(std::equal(samples.begin(), samples.end(), resumed.begin(), resumed.end(), Same)) << piece;
  }
}

// A quarter of its points let go for what covers it: while that hides all the others the object stays where it was.
TEST(ObjectGroupTest, AHiddenObjectDoesNotGoWithTheFewThatHaveLeft) {
  const auto samples = FinalOfLargeSquare(
      48,
      [](uint32_t i, Pixel home, int64_t t) -> Seen {
        const bool goes = i % 4 == 0;
        return {{home.x + (goes ? 10 * static_cast<float>(t) : 0), home.y}, goes || t < 20};
      },
      60);
  ASSERT_THAT(samples, SizeIs(60));
  EXPECT_NEAR(samples[59].centre.x, 200, 1e-3);
  EXPECT_THAT(samples[59].left, SizeIs(12));
}

TEST(ObjectGroupTest, FinalSamplesDoNotDependOnHowTheEstimatesCame) {
  const World world = Losing(9);
  const ObjectRun whole = Final(world, 30);
  for (const int64_t piece : {1, 2, 7, 8, 30}) {
    const auto finals = InPieces(world, 30, piece, ObjectGroup(kId, kQuery, Square(), Nine()));
    ASSERT_EQ(finals.size(), whole.samples.size());
    for (size_t i = 0; i < finals.size(); ++i) EXPECT_TRUE(Same(finals[i], whole.samples[i])) << piece << ": " << i;
  }
}

TEST(ObjectGroupTest, ProvisionalSamplesComeWhenTheyAreNewOrRevised) {
  ObjectGroup group(kId, kQuery, Square(), Nine());
  AddAll(group, Shifting, kQuery, kQuery + 8, 1);
  auto run = group.TakeRun(/*provisional=*/true);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->final_count, 1);
  EXPECT_THAT(run->samples, SizeIs(8));
  EXPECT_FALSE(group.TakeRun(/*provisional=*/true));
  AddAll(group, Shifting, kQuery + 8, kQuery + 9, 0);
  run = group.TakeRun(/*provisional=*/true);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->first_frame, kQuery + 8);
  EXPECT_EQ(run->final_count, 0);
  ASSERT_THAT(run->samples, SizeIs(1));
  EXPECT_NEAR(run->samples[0].centre.x, 66, 1e-3);
  group.Add(RunOf(3, Losing(0), kQuery + 4, kQuery + 9, 0));
  run = group.TakeRun(/*provisional=*/true);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->first_frame, kQuery + 4);
  EXPECT_THAT(run->samples, SizeIs(5));
}

TEST(ObjectGroupTest, GoesOnWithoutPointsThatWereRemoved) {
  ObjectGroup group(kId, kQuery, Square(), Nine());
  AddAll(group, Shifting, kQuery, kQuery + 5, 5);
  group.Remove(ObjectPointId(kId, 0), kQuery + 7);
  (void)group.TakeRun(false);
  for (uint32_t i = 1; i < 9; ++i) group.Add(RunOf(i, Shifting, kQuery + 5, kQuery + 12, 7));
  EXPECT_FALSE(group.TakeRun(false));  // the point is still wanted on frames 5 to 7
  group.Add(RunOf(0, Shifting, kQuery + 5, kQuery + 8, 3));
  const auto run = group.TakeRun(false);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->final_count, 7);
  EXPECT_FALSE(group.ended());
  for (uint32_t i = 1; i < 9; ++i) group.Remove(ObjectPointId(kId, i), kQuery + 11);
  EXPECT_TRUE(group.ended());
  EXPECT_FALSE(group.TakeRun(true));
}

// Windows of 24 frames every 8 meet at the query + 8, + 16...
constexpr ObjectWindows kWindows{24, 8};
constexpr PointId kLost = ObjectPointId(kId, 4), kNew = ObjectPointId(kId, 260);

// A group that has lost point 4 by frame kQuery + 8, where it waits for a new one.
ObjectGroup Waiting(int64_t newest = ObjectMember::kNever) {
  ObjectGroup group(kId, kQuery, Square(), Nine(), kWindows);
  AddAll(group, Losing(0), kQuery, kQuery + 24, 9);
  (void)group.TakeRun(/*provisional=*/true, newest);
  return group;
}

PointRun RunOfNew(int64_t begin, int64_t end, int64_t finals) {
  PointRun run = RunOf(4, Shifting, begin, end, finals);
  run.id = kNew;
  return run;
}

TEST(ObjectGroupTest, APointThatHasLeftIsPlacedAnewWhereWindowsMeet) {
  ObjectGroup group = Waiting();
  ASSERT_TRUE(group.reseeding());
  EXPECT_EQ(group.reseeding()->frame, kQuery + 8);
  EXPECT_THAT(group.reseeding()->lost, ElementsAre(kLost));
  EXPECT_EQ(group.meeting(), kQuery + 8);
  EXPECT_EQ(group.covered_at_meeting(), kQuery + 23);
  EXPECT_FALSE(group.TakeRun(true)) << "a frame after it";
  const auto made = group.Reseed(std::vector<Pixel>{{66, 50}});
  ASSERT_THAT(made, SizeIs(1));
  EXPECT_EQ(made[0].before, kLost);
  EXPECT_EQ(made[0].before_queried, kQuery);
  EXPECT_EQ(made[0].point.id, kNew);
  EXPECT_EQ(made[0].point.x, 66);
  EXPECT_FALSE(made[0].removed_after);
  EXPECT_TRUE(group.WasPlacedAnew(kNew, kQuery + 8));
  EXPECT_EQ(group.meeting(), kQuery + 16);
}

TEST(ObjectGroupTest, ThePointBeforeEndsWithItsWindow) {
  ObjectGroup group = Waiting();
  (void)group.Reseed(std::vector<Pixel>{{66, 50}});
  AddAll(group, Losing(0), kQuery + 9, kQuery + 32, 23);
  group.Add(RunOfNew(kQuery + 8, kQuery + 32, 24));
  const auto run = group.TakeRun(false, /*newest=*/kQuery + 31);
  ASSERT_TRUE(run);
  ASSERT_EQ(run->first_frame, kQuery + 9);
  ASSERT_THAT(run->samples, SizeIs(23));
  EXPECT_THAT(run->samples[0].joined, ElementsAre(kNew));
  EXPECT_THAT(run->samples[1].joined, IsEmpty());
  EXPECT_THAT(run->samples[14].left, ElementsAre(kLost));
  EXPECT_THAT(run->samples[15].left, IsEmpty()) << "its window came to frame kQuery + 23";
  EXPECT_NEAR(run->samples[22].centre.x, 50 + 2 * 31, 1e-3);
  EXPECT_THAT(group.StateBefore(1000).members, SizeIs(10));
}

TEST(ObjectGroupTest, WindowsThatHardlyOverlapEndThePointBeforeAtOnce) {
  const ObjectWindows windows{24, 23};
  ObjectGroup group(kId, kQuery, Square(), Nine(), windows);
  AddAll(group, Losing(0), kQuery, kQuery + 24, 24);
  (void)group.TakeRun(false, kQuery + 23);
  ASSERT_TRUE(group.reseeding());
  EXPECT_EQ(group.covered_at_meeting(), kQuery + 23);
  (void)group.Reseed(std::vector<Pixel>{{96, 50}});
  // What was said at the newest frame comes again, but not who was placed anew there.
  ObjectGroup again(group.StateBefore(kQuery + 23), windows);
  EXPECT_TRUE(again.WasPlacedAnew(kNew, kQuery + 23));
  EXPECT_THAT(again.StateBefore(1000).members, SizeIs(9));
  EXPECT_EQ(again.meeting(), kQuery + 46);
}

TEST(ObjectGroupTest, TheFirstPointsTellTheMotionWhileThereAreEnough) {
  // Point 4 has been placed anew, and shifts by a pixel a frame more than the others, which lie within what is allowed.
  for (const int hidden : {0, 7}) {
    ObjectGroup group = Waiting();
    (void)group.Reseed(std::vector<Pixel>{{66, 50}});
    const auto seen = [hidden](uint32_t i, Pixel home, int64_t t) {
      Seen seen = Losing(0)(i, home, t);
      seen.visible = static_cast<int>(i) >= hidden;
      return seen;
    };
    AddAll(group, seen, kQuery + 9, kQuery + 12, 3);
    PointRun anew = RunOfNew(kQuery + 8, kQuery + 12, 4);
    for (size_t i = 1; i < 4; ++i) anew.x[i] += 2;
    group.Add(anew);
    const auto run = group.TakeRun(false, kQuery + 31);
    ASSERT_TRUE(run);
    const double off = run->samples[2].centre.x - (50 + 2 * 11);
    if (hidden == 0) {
      EXPECT_NEAR(off, 0, 1e-3);
    } else {
      EXPECT_GT(off, 0.1) << "two of the first ones are too few";
    }
  }
}

TEST(ObjectGroupTest, GoesOnWithoutANewPointWhereThereIsNoPlace) {
  ObjectGroup group = Waiting();
  EXPECT_THAT(group.Reseed({}), IsEmpty());
  AddAll(group, Losing(0), kQuery + 9, kQuery + 17, 8);
  const auto run = group.TakeRun(false, kQuery + 31);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->first_frame, kQuery + 9);
  EXPECT_THAT(run->samples, SizeIs(8));
  EXPECT_TRUE(group.reseeding()) << "the next time that windows meet";
}

TEST(ObjectGroupTest, NobodyIsPlacedAnewWhereTheVideoEnds) {
  EXPECT_FALSE(Waiting(/*newest=*/kQuery + 22).reseeding()) << "that window was the last one";
  EXPECT_TRUE(Waiting(/*newest=*/kQuery + 23).reseeding());
}

TEST(ObjectGroupTest, WhoIsRemovedIsRemovedWithAllOfItsPlace) {
  ObjectGroup early(kId, kQuery, Square(), Nine(), kWindows);
  AddAll(early, Losing(0), kQuery, kQuery + 24, 9);
  EXPECT_THAT(early.Remove(kLost, kQuery + 22), ElementsAre(kLost));
  (void)early.TakeRun(true);
  EXPECT_FALSE(early.reseeding()) << "it had ended before its window";
  ObjectGroup late(kId, kQuery, Square(), Nine(), kWindows);
  AddAll(late, Losing(0), kQuery, kQuery + 24, 9);
  (void)late.Remove(kLost, kQuery + 30);
  (void)late.TakeRun(true);
  ASSERT_TRUE(late.reseeding());
  const auto made = late.Reseed(std::vector<Pixel>{{66, 50}});
  EXPECT_EQ(made[0].removed_after, kQuery + 30) << "as if it had been placed before that was said";
  ObjectGroup after = Waiting();
  (void)after.Reseed(std::vector<Pixel>{{66, 50}});
  EXPECT_THAT(after.Remove(kLost, kQuery + 30), ElementsAre(kNew));
}

TEST(ObjectGroupTest, AStateHoldsWhoWasPlacedAnew) {
  ObjectGroup before = Waiting();
  (void)before.Reseed(std::vector<Pixel>{{66, 50}});
  // What was said at frame kQuery + 23 comes again, but not that the point before ends there.
  ObjectGroup group(before.StateBefore(kQuery + 23), kWindows);
  AddAll(group, Losing(0), kQuery + 9, kQuery + 32, 23);
  group.Add(RunOfNew(kQuery + 8, kQuery + 32, 24));
  const auto run = group.TakeRun(false, kQuery + 31);
  ASSERT_TRUE(run);
  EXPECT_THAT(run->samples[0].joined, ElementsAre(kNew));
  EXPECT_THAT(run->samples[14].left, ElementsAre(kLost));
  EXPECT_THAT(run->samples[15].left, IsEmpty());
}

TEST(ObjectGroupTest, IgnoresThePointsOfOthers) {
  ObjectGroup group(kId, kQuery, Square(), Nine());
  PointRun stranger = RunOf(0, Shifting, kQuery, kQuery + 5, 5);
  stranger.id = 0;
  group.Add(stranger);
  EXPECT_FALSE(group.TakeRun(true));
}

}  // namespace
}  // namespace holdfast
