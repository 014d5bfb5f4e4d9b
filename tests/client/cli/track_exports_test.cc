// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_exports.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr VideoFacts kSource{{64, 48}, 10};
constexpr TrackExtent kFiveFrames{5, 5, 5, true};

// Of tests/python/tracks_test.py and web/tests/unit/exports.test.ts too: one that ends early, one with a gap, and one
// without a name that begins late, hides and leaves the picture.
TrackTable ThreePoints() {
  TrackTable table({{{4, 0, 0}, 0, "nose, \"left\" <1>"}, {{7, 0, 0}, 0, "paw"}, {{9, 0, 0}, 1, "9"}});
  const PointRun first{4, 0, {1.25f, 2.0004f}, {10, 20}, {1, 1}, {0.5f, 0.25f}, 2};
  const PointRun before{7, 0, {5, 6}, {-0.5f, 30}, {1, 0}, {0.75f, 0.0625f}, 2};
  const PointRun after{7, 3, {8, 9}, {31, 32}, {1, 1}, {1, 1}, 2};
  const PointRun last{9, 1, {61, 62, 63.4f, 63.5f}, {40, 41, 42, 43}, {0, 1, 1, 1}, {0.125f, 1, 1, 1}, 4};
  EXPECT_THAT(table.Apply({{first, before, after, last}, 5, 5}), IsOk());
  return table;
}

// What the Python client and the page for browsers write too.
std::string Expected(const std::string& name) {
  std::ifstream file(InSourceTree(absl::StrCat("tests/data/exports/", name)));
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(TrackExportsTest, DeepLabCutHasThreeRowsOfHeadingsAndOneForEachFrame) {
  std::ostringstream out;
  WriteDeepLabCut(out, ThreePoints(), kFiveFrames);
  EXPECT_EQ(out.str(), Expected("tracks.dlc.csv"));
}

TEST(TrackExportsTest, CvatHasATrackForEachPointThatIsOutsideWhereItIsNot) {
  std::ostringstream out;
  WriteCvat(out, ThreePoints(), kSource, kFiveFrames);
  EXPECT_EQ(out.str(), Expected("tracks.xml"));
}

TEST(TrackExportsTest, ThreeDeHasACurveForEachPointWhereItIsSeen) {
  std::ostringstream out;
  Write3de(out, ThreePoints(), kSource);
  EXPECT_EQ(out.str(), Expected("tracks.3de.txt"));
}

TEST(TrackExportsTest, BodyPartsAreToldApart) {
  const TrackTable table({{{1, 0, 0}, 0, "paw"}, {{2, 0, 0}, 0, "paw"}, {{3, 0, 0}, 0, ""}, {{4, 0, 0}, 0, "paw_2"}});
  std::ostringstream out;
  WriteDeepLabCut(out, table, {});
  EXPECT_THAT(out.str(), HasSubstr("bodyparts,paw,paw,paw,paw_2,paw_2,paw_2,3,3,3,paw_2_4,paw_2_4,paw_2_4\n"));
}

// CVAT shows a shape on all frames up to the next one.
TEST(TrackExportsTest, CvatIsOutsideBehindTheLastFrameWhereTheInputGoesOn) {
  TrackTable table({{{4, 0, 0}, 10, "nose"}, {{7, 0, 0}, 10, "paw"}});
  for (const int64_t number : {10, 12}) table.AddFrame(number);
  const PointRun to_the_end{4, 0, {1, 2}, {3, 4}, {1, 1}, {1, 1}, 2}, shorter{7, 0, {5}, {6}, {1}, {1}, 1};
  ASSERT_THAT(table.Apply({{to_the_end, shorter}, 2, 2}), IsOk());
  std::ostringstream ends, goes_on;
  WriteCvat(ends, table, kSource, {2, 2, 2, true});
  EXPECT_THAT(ends.str(), Not(HasSubstr("frame=\"13\"")));
  WriteCvat(goes_on, table, kSource, {2, 2, 2, true, /*input_goes_on=*/true});
  EXPECT_THAT(goes_on.str(), HasSubstr("<size>14</size>"));
  const std::string behind = "frame=\"13\" keyframe=\"1\" outside=\"1\" occluded=\"0\" points=";
  EXPECT_THAT(goes_on.str(), HasSubstr(behind + "\"2.000,4.000\""));
  EXPECT_THAT(goes_on.str(), Not(HasSubstr(behind + "\"5.000,6.000\""))) << "it was outside before";
}

// It would not import the file.
TEST(TrackExportsTest, CvatHasNoTrackWithoutAShape) {
  TrackTable table({{{4, 0, 0}, 0, "nose"}, {{7, 0, 0}, 9, "late"}});
  ASSERT_THAT(table.Apply({{{4, 0, {1}, {2}, {1}, {1}, 1}}, 1, 1}), IsOk());
  std::ostringstream out;
  WriteCvat(out, table, kSource, {1, 1, 1, true});
  EXPECT_THAT(out.str(), HasSubstr("<track id=\"4\" label=\"nose\""));
  EXPECT_THAT(out.str(), Not(HasSubstr("<track id=\"7\"")));
  EXPECT_THAT(out.str(), Not(HasSubstr("late")));
}

TEST(TrackExportsTest, CharactersThatXmlHasNotAreLeftOut) {
  std::ostringstream out;
  TrackTable table({{{1, 0, 0},
                     0,
                     std::string("a\x01"
                                 "b\0c",
                                 5)}});
  ASSERT_THAT(table.Apply({{{1, 0, {1}, {2}, {1}, {1}, 1}}, 1, 1}), IsOk());
  WriteCvat(out, table, kSource, {1, 1, 1, true});
  EXPECT_THAT(out.str(), HasSubstr("label=\"a b c\""));
}

TEST(TrackExportsTest, ThreeDeCountsFromTheLowerLeftCornerAndFromFrameOne) {
  // A picture of 64x48: the centre of its first pixel, and that of its last, half a pixel from the corners.
  TrackTable table({{{4, 0, 0}, 0, "top\nleft"}, {{9, 0, 0}, 1, "9"}});
  const PointRun first{4, 0, {0, 63, 1.25f}, {0, 47, 10}, {1, 1, 1}, {1, 1, 1}, 3};
  const PointRun second{9, 1, {7, 8}, {20, 30}, {0, 1}, {1, 1}, 2};
  ASSERT_THAT(table.Apply({{first, second}, 3, 3}), IsOk());
  std::ostringstream out;
  Write3de(out, table, kSource);
  EXPECT_EQ(out.str(),
            "2\n"
            "top left\n0\n3\n1 0.500000 47.500000\n2 63.500000 0.500000\n3 1.750000 37.500000\n"
            "9\n0\n1\n3 8.500000 17.500000\n");
}

TEST(TrackExportsTest, FramesHaveTheNumbersOfTheInput) {
  TrackTable table({{{4, 0, 0}, 10, "4"}});
  for (const int64_t number : {10, 12, 14}) table.AddFrame(number);
  ASSERT_THAT(table.Apply({{{4, 0, {1, 2}, {3, 4}, {1, 1}, {1, 1}, 2}}, 3, 3}), IsOk());
  std::ostringstream dlc, cvat, tracks_3de;
  WriteDeepLabCut(dlc, table, {3, 3, 3, true});
  EXPECT_THAT(dlc.str(), HasSubstr("\n10,1.000,3.000,1.000\n12,2.000,4.000,1.000\n14,,,\n"));
  WriteCvat(cvat, table, kSource, {3, 3, 3, true});
  EXPECT_THAT(cvat.str(), HasSubstr("<size>15</size>"));
  EXPECT_THAT(cvat.str(), HasSubstr("frame=\"12\" keyframe=\"1\" outside=\"0\""));
  EXPECT_THAT(cvat.str(), HasSubstr("frame=\"14\" keyframe=\"1\" outside=\"1\""));
  Write3de(tracks_3de, table, kSource);
  EXPECT_THAT(tracks_3de.str(), HasSubstr("\n2\n11 1.500000 44.500000\n13 2.500000 43.500000\n"));
}

}  // namespace
}  // namespace holdfast
