// SPDX-License-Identifier: Apache-2.0
#include "training/weight_average.h"

#include <gtest/gtest.h>
#include <torch/nn/modules/linear.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

torch::nn::Linear Network(float value) {
  torch::nn::Linear network(1, 1);
  torch::NoGradGuard no_grad;
  for (torch::Tensor& parameter : network->parameters()) parameter.fill_(value);
  return network;
}

float Weight(const torch::nn::Linear& network) { return network->weight.item<float>(); }

TEST(WeightAverageTest, ForgetsTheStartFastAndThenDecaysAsAsked) {
  WeightAverage average(*Network(0), 0.5);
  torch::nn::Linear network = Network(10);
  average.Update(*network);  // keeps 1 / 10
  torch::nn::Linear out = Network(0);
  average.CopyTo(*out);
  EXPECT_FLOAT_EQ(Weight(out), 9.0f);
  for (int i = 0; i < 20; ++i) average.Update(*network);
  network = Network(20);
  average.CopyTo(*out);
  const float before = Weight(out);
  average.Update(*network);  // keeps 0.5
  average.CopyTo(*out);
  EXPECT_FLOAT_EQ(Weight(out), (before + 20) / 2);
}

TEST(WeightAverageTest, WithoutDecayEqualsTheWeights) {
  WeightAverage average(*Network(0), 0);
  average.Update(*Network(3));
  torch::nn::Linear out = Network(0);
  average.CopyTo(*out);
  EXPECT_EQ(Weight(out), 3.0f);
}

TEST(WeightAverageTest, GoesOnFromASavedOne) {
  WeightAverage a(*Network(0), 0.9);
  a.Update(*Network(1));
  WeightAverage b(*Network(7), 0.9);
  ASSERT_THAT(b.Restore(a.tensors(), a.updates()), IsOk());
  a.Update(*Network(2));
  b.Update(*Network(2));
  EXPECT_TRUE(torch::equal(a.tensors().at("weight"), b.tensors().at("weight")));
}

TEST(WeightAverageTest, RefusesAnotherNetworksAverage) {
  WeightAverage average(*Network(0), 0.9);
  torch::nn::Linear wide(2, 1);
  EXPECT_THAT(average.Restore(WeightAverage(*wide, 0.9).tensors(), 1), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace holdfast
