// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_exports.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

constexpr VideoFacts kVideo{{64, 48}, 10};
constexpr TrackExtent kFourFrames{4, 4, 4, true};

// A point with a name that ends early, and one without that begins late and is hidden once.
TrackTable Example() {
  TrackTable table({{{4, 0, 0}, 0, "nose, \"left\" <1>"}, {{9, 0, 0}, 1, "9"}});
  const PointRun first{4, 0, {1.25f, 2.0004f}, {10, 20}, {1, 1}, {0.5f, 0.25f}, 2};
  const PointRun second{9, 1, {7, 8, 9}, {70, 80, 90}, {0, 1, 1}, {0.125f, 1, 1}, 3};
  EXPECT_THAT(table.Apply({{first, second}, 4, 4}), IsOk());
  return table;
}

TEST(TrackExportsTest, DeepLabCutHasThreeRowsOfHeadingsAndOneForEachFrame) {
  std::ostringstream out;
  WriteDeepLabCut(out, Example(), kFourFrames);
  EXPECT_EQ(out.str(),
            "scorer,holdfast,holdfast,holdfast,holdfast,holdfast,holdfast\n"
            "bodyparts,\"nose, \"\"left\"\" <1>\",\"nose, \"\"left\"\" <1>\",\"nose, \"\"left\"\" <1>\",9,9,9\n"
            "coords,x,y,likelihood,x,y,likelihood\n"
            "0,1.250,10.000,0.500,,,\n"
            "1,2.000,20.000,0.250,7.000,70.000,0.125\n"
            "2,,,,8.000,80.000,1.000\n"
            "3,,,,9.000,90.000,1.000\n");
}

TEST(TrackExportsTest, BodyPartsAreToldApart) {
  const TrackTable table({{{1, 0, 0}, 0, "paw"}, {{2, 0, 0}, 0, "paw"}, {{3, 0, 0}, 0, ""}, {{4, 0, 0}, 0, "paw_2"}});
  std::ostringstream out;
  WriteDeepLabCut(out, table, {});
  EXPECT_THAT(out.str(), HasSubstr("bodyparts,paw,paw,paw,paw_2,paw_2,paw_2,3,3,3,paw_2_4,paw_2_4,paw_2_4\n"));
}

TEST(TrackExportsTest, CvatHasATrackForEachPointThatEndsOutside) {
  std::ostringstream out;
  WriteCvat(out, Example(), kVideo, kFourFrames);
  EXPECT_EQ(out.str(), R"(<?xml version="1.0" encoding="utf-8"?>
<annotations>
<version>1.1</version>
<meta><task><size>4</size><mode>interpolation</mode><original_size><width>64</width><height>48</height></original_size>
<labels>
<label><name>nose, &quot;left&quot; &lt;1&gt;</name><type>points</type><attributes></attributes></label>
<label><name>point</name><type>points</type><attributes></attributes></label>
</labels></task></meta>
<track id="4" label="nose, &quot;left&quot; &lt;1&gt;" source="auto">
  <points frame="0" keyframe="1" outside="0" occluded="0" points="1.250,10.000" z_order="0"></points>
  <points frame="1" keyframe="1" outside="0" occluded="0" points="2.000,20.000" z_order="0"></points>
  <points frame="2" keyframe="1" outside="1" occluded="0" points="2.000,20.000" z_order="0"></points>
</track>
<track id="9" label="point" source="auto">
  <points frame="1" keyframe="1" outside="0" occluded="1" points="7.000,70.000" z_order="0"></points>
  <points frame="2" keyframe="1" outside="0" occluded="0" points="8.000,80.000" z_order="0"></points>
  <points frame="3" keyframe="1" outside="0" occluded="0" points="9.000,90.000" z_order="0"></points>
</track>
</annotations>
)");
}

TEST(TrackExportsTest, CharactersThatXmlHasNotAreLeftOut) {
  std::ostringstream out;
  WriteCvat(out,
            TrackTable({{{1, 0, 0},
                         0,
                         std::string("a\x01"
                                     "b\0c",
                                     5)}}),
            kVideo, {});
  EXPECT_THAT(out.str(), HasSubstr("label=\"a b c\""));
}

}  // namespace
}  // namespace holdfast
