// SPDX-License-Identifier: Apache-2.0
#include "model/precision_check.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>
#include <limits>

#include "model/checkpoint/checkpoint.h"
#include "model/presets.h"
#include "tests/support/source_tree.h"

namespace holdfast {
namespace {

class PrecisionCheckTest : public testing::Test {
 protected:
  void SetUp() override {
    auto loaded = LoadModel(InSourceTree("weights/small.safetensors"));
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    exact_ = loaded->model;
  }

  PointModel exact_{nullptr};
};

TEST_F(PrecisionCheckTest, ANetworkAgreesWithItself) {
  const PrecisionDifference same = ComparePrecisions(exact_, exact_, CheckPicture(64, 96));
  EXPECT_EQ(same.features, 0);
  EXPECT_EQ(same.positions, 0);
  EXPECT_TRUE(same.within());
}

TEST_F(PrecisionCheckTest, RoundingIsSeenAndWithinTheBounds) {
  const PointModel fast = CopyInPrecision(exact_, torch::kBFloat16);
  const PrecisionDifference rounded = ComparePrecisions(exact_, fast, CheckPicture(160, 96));
  EXPECT_GT(rounded.features, 0);
  EXPECT_TRUE(rounded.within()) << ToString(rounded);
}

TEST_F(PrecisionCheckTest, WrongFeaturesAreFound) {
  PointModel wrong = CopyInPrecision(exact_, torch::kBFloat16);
  const torch::NoGradGuard no_grad;
  wrong->named_parameters()["fnet.layer2.0.conv1.weight"].mul_(-1);
  const PrecisionDifference difference = ComparePrecisions(exact_, wrong, CheckPicture(64, 64));
  EXPECT_FALSE(difference.within()) << ToString(difference);
}

TEST_F(PrecisionCheckTest, AWrongUpdateBlockIsFound) {
  PointModel wrong = CopyInPrecision(exact_, torch::kBFloat16);
  const torch::NoGradGuard no_grad;
  wrong->named_parameters()["delta_block.dense.bias"].add_(1);
  const PrecisionDifference difference = ComparePrecisions(exact_, wrong, CheckPicture(64, 64));
  EXPECT_LT(difference.features, PrecisionDifference::kMaxFeatures);
  EXPECT_FALSE(difference.within()) << ToString(difference);
}

TEST_F(PrecisionCheckTest, WhatIsNotANumberIsNotWithin) {
  PointModel wrong = CopyInPrecision(exact_, torch::kBFloat16);
  const torch::NoGradGuard no_grad;
  wrong->named_parameters()["fnet.conv3.bias"].fill_(std::numeric_limits<float>::quiet_NaN());
  EXPECT_FALSE(ComparePrecisions(exact_, wrong, CheckPicture(64, 64)).within());
}

// One channel: were it taken as zero between the layers, the rest would be close enough.
TEST_F(PrecisionCheckTest, WhatIsNotANumberInTheMiddleComesOut) {
  const torch::NoGradGuard no_grad;
  for (const torch::ScalarType dtype : {torch::kFloat32, torch::kBFloat16}) {
    PointModel wrong = CopyInPrecision(exact_, dtype);
    wrong->named_parameters()["fnet.layer2.0.conv1.bias"][0] = std::numeric_limits<float>::quiet_NaN();
    const PrecisionDifference difference = ComparePrecisions(exact_, wrong, CheckPicture(64, 64));
    EXPECT_TRUE(std::isnan(difference.features)) << dtype;
    EXPECT_FALSE(difference.within()) << dtype;
  }
}

TEST_F(PrecisionCheckTest, ACopySharesNothing) {
  const PointModel copy = CopyInPrecision(exact_, torch::kFloat32);
  const auto from = exact_->named_parameters(), to = copy->named_parameters();
  ASSERT_EQ(from.size(), to.size());
  for (const auto& entry : from) {
    EXPECT_TRUE(torch::equal(entry.value(), to[entry.key()])) << entry.key();
    EXPECT_NE(entry.value().data_ptr(), to[entry.key()].data_ptr()) << entry.key();
  }
}

// Networks that a training begins with: nothing but rounding sets the two apart, however much they make of it.
TEST(PrecisionCheckRandomTest, RandomWeightsAreWithinTheBoundsToo) {
  for (const char* name : {"test", "small", "pips2"}) {
    torch::manual_seed(3);
    PointModel model(*PresetByName(name));
    model->eval();
    const PointModel fast = CopyInPrecision(model, torch::kBFloat16);
    const PrecisionDifference difference = ComparePrecisions(model, fast, CheckPicture(96, 128));
    EXPECT_TRUE(difference.within()) << name << ": " << ToString(difference);
  }
}

TEST(CheckPictureTest, HasStructure) {
  const torch::Tensor picture = CheckPicture(32, 64);
  EXPECT_EQ(picture.sizes(), (std::vector<int64_t>{32, 64, 3}));
  EXPECT_TRUE(torch::equal(picture, CheckPicture(32, 64)));
  EXPECT_GT(picture.to(torch::kFloat32).std().item<float>(), 20);
}

}  // namespace
}  // namespace holdfast
