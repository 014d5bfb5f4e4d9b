// SPDX-License-Identifier: Apache-2.0
#include "server/engine/precision_switch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "model/ops/sampling.h"
#include "model/precision_check.h"
#include "tests/support/networks.h"
#include "tests/support/recorders.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

PointModel Rounded(const PointModel& exact) { return CopyInPrecision(exact, torch::kBFloat16); }

TEST(PrecisionSwitchTest, WithoutAChoiceEverySizeHasTheOnlyNetwork) {
  RecordingMetrics metrics;
  const PointModel only = Rounded(RandomModel());
  PrecisionSwitch networks(only, metrics);
  EXPECT_EQ(networks.FeatureType({64, 32}), torch::kBFloat16);
  EXPECT_EQ(networks.ForSize({64, 32}).get(), only.get());
  EXPECT_THAT(metrics.totals().fell_back, IsEmpty());
}

TEST(PrecisionSwitchTest, ANetworkThatAgreesIsTaken) {
  RecordingMetrics metrics;
  const PointModel exact = RandomModel(), fast = Rounded(exact);
  PrecisionSwitch networks(exact, fast, metrics);
  EXPECT_EQ(networks.FeatureType({64, 32}), torch::kFloat32) << "not tried yet: the larger type";
  EXPECT_EQ(networks.ForSize({64, 32}).get(), fast.get());
  EXPECT_EQ(networks.FeatureType({64, 32}), torch::kBFloat16);
  EXPECT_EQ(networks.FeatureType({32, 64}), torch::kFloat32) << "another size";
  EXPECT_THAT(metrics.totals().fell_back, IsEmpty());
}

TEST(PrecisionSwitchTest, WhereTheyDisagreeTheExactOneIsTakenAndToldOfOnce) {
  RecordingMetrics metrics;
  const PointModel exact = RandomModel();
  PrecisionSwitch networks(exact, BrokenCopy(exact), metrics);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(networks.ForSize({64, 32}).get(), exact.get());
  EXPECT_EQ(networks.FeatureType({64, 32}), torch::kFloat32);
  EXPECT_THAT(metrics.totals().fell_back, ElementsAre(ImageSize{64, 32}));
  networks.ForSize({96, 32});
  EXPECT_THAT(metrics.totals().fell_back, ElementsAre(ImageSize{64, 32}, ImageSize{96, 32}));
}

// Three points that rest on 'picture'.
WindowRows RowsOn(PointModel model, const torch::Tensor& picture) {
  const c10::InferenceMode guard;
  const FeaturePyramid pyramid =
      BuildPyramid(model->Encode(picture.unsqueeze(0))[0], model->options().correlation_levels);
  WindowRows rows;
  rows.frames.assign(8, pyramid);
  const torch::Tensor xy = torch::tensor({{1.5f, 1.5f}, {3.25f, 2.0f}, {6.0f, 0.5f}});
  rows.start = xy.unsqueeze(1).repeat({1, 8, 1});
  rows.feature = SampleFeatures(pyramid, xy);
  return rows;
}

TEST(PrecisionSwitchTest, GroupsOfBothTypesInOneBatchGoBackToTheirNetworksInOrder) {
  RecordingMetrics metrics;
  const PointModel exact = RandomModel(), fast = Rounded(exact);
  PrecisionSwitch networks(exact, fast, metrics);
  const torch::Tensor pictures[] = {CheckPicture(32, 64), CheckPicture(64, 64), CheckPicture(32, 96)};
  const std::vector<WindowRows> groups = {RowsOn(exact, pictures[0]), RowsOn(fast, pictures[1]),
                                          RowsOn(fast, pictures[2]), RowsOn(exact, pictures[2])};
  const std::vector<WindowEstimate> mixed = networks.Refine(groups, {2, false});
  ASSERT_EQ(mixed.size(), groups.size());
  for (size_t i = 0; i < groups.size(); ++i) {
    PointModel own = i == 1 || i == 2 ? fast : exact;
    EXPECT_TRUE(torch::equal(mixed[i].positions, own->Refine({groups[i]}, {2, false}).front().positions)) << i;
  }
}

}  // namespace
}  // namespace holdfast
