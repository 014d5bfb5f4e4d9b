// SPDX-License-Identifier: Apache-2.0
#include "training/precision_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include "model/precision.h"
#include "model/precision_check.h"
#include "tests/support/networks.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Optional;

const std::vector<Phase> kPhases = {{0.5, 48, 64, 8, 2}, {1.0, 72, 40, 8, 2}};

TEST(PrecisionChoiceTest, ANetworkThatIsOnlyRoundedMayRun) {
  const PointModel model = RandomModel();
  EXPECT_EQ(WhyNotRun(CopyInPrecision(model, torch::kBFloat16), model, kPhases), std::nullopt);
}

TEST(PrecisionChoiceTest, OneThatComputesSomethingElseMayNotAndTheSizeIsNamed) {
  const PointModel model = RandomModel();
  EXPECT_THAT(WhyNotRun(BrokenCopy(model), model, kPhases), Optional(HasSubstr("at 64x48: features differ by")));
}

TEST(PrecisionChoiceTest, FollowsTheDevice) {
  const auto why = WhyNotBfloat16(RandomModel(), kPhases);
  if (ComputesBFloat16Faster(torch::kCPU)) {
    EXPECT_EQ(why, std::nullopt);
  } else {
    EXPECT_THAT(why, Optional(HasSubstr("not faster")));
  }
}

}  // namespace
}  // namespace holdfast
