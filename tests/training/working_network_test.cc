// SPDX-License-Identifier: Apache-2.0
#include "training/working_network.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstddef>
#include <vector>

#include "tests/support/networks.h"

namespace holdfast {
namespace {

void Fill(PointModel& model, double value) {
  const torch::NoGradGuard no_grad;
  for (torch::Tensor& parameter : model->parameters()) parameter.fill_(value);
}

void ExpectAll(PointModelImpl& model, double value) {
  for (const torch::Tensor& parameter : model.parameters()) {
    EXPECT_TRUE(torch::all(parameter.to(torch::kFloat64) == value).item<bool>()) << parameter.sizes();
  }
}

// Gives every parameter of the network a gradient of this value, as a backward pass would.
void SetGradients(PointModelImpl& network, double value) {
  for (torch::Tensor& parameter : network.parameters()) parameter.mutable_grad() = torch::full_like(parameter, value);
}

void ExpectGradients(const PointModel& model, double value) {
  for (const torch::Tensor& parameter : model->parameters()) {
    ASSERT_TRUE(parameter.grad().defined());
    EXPECT_EQ(parameter.grad().scalar_type(), torch::kFloat32);
    EXPECT_TRUE(torch::all(parameter.grad() == value).item<bool>()) << parameter.sizes();
  }
}

TEST(WorkingNetworkTest, InFullPrecisionItIsTheMasterItself) {
  PointModel master(TinyOptions());
  WorkingNetwork working(master, torch::kFloat32);
  EXPECT_EQ(&working.network(), master.get());
  SetGradients(*master, 3);
  working.CollectGradients();
  working.Refresh();
  ExpectGradients(master, 3);
}

// bfloat16 has 8 binary digits: above 1 they are 2^-7 apart, and halves go to the even neighbour.
TEST(WorkingNetworkTest, ACopyHasTheMastersRoundedWeights) {
  PointModel master(TinyOptions());
  Fill(master, 1 + 0x1.8p-7);
  WorkingNetwork working(master, torch::kBFloat16);
  EXPECT_NE(&working.network(), master.get());
  for (const torch::Tensor& parameter : working.network().parameters()) {
    EXPECT_EQ(parameter.scalar_type(), torch::kBFloat16);
    EXPECT_TRUE(parameter.requires_grad());
  }
  ExpectAll(working.network(), 1 + 0x1p-6);
  ExpectAll(*master, 1 + 0x1.8p-7);
}

TEST(WorkingNetworkTest, EveryParameterIsCopiedToItsOwnPlace) {
  PointModel master(TinyOptions());
  const std::vector<torch::Tensor> from = master->parameters();
  {
    const torch::NoGradGuard no_grad;
    for (size_t i = 0; i < from.size(); ++i) from[i].fill_(static_cast<double>(i));
  }
  WorkingNetwork working(master, torch::kBFloat16);
  const auto named = working.network().named_parameters();
  for (const auto& parameter : master->named_parameters()) {
    EXPECT_TRUE(torch::equal(named[parameter.key()].to(torch::kFloat32),
                             parameter.value().to(torch::kBFloat16).to(torch::kFloat32)))
        << parameter.key();
  }
}

TEST(WorkingNetworkTest, SmallUpdatesOfTheMasterAddUp) {
  PointModel master(TinyOptions());
  Fill(master, 1);
  WorkingNetwork working(master, torch::kBFloat16);
  for (int step = 0; step < 8; ++step) {
    ExpectAll(working.network(), step * 0x1p-10 > 0x1p-8 ? 1 + 0x1p-7 : 1);
    {
      const torch::NoGradGuard no_grad;
      for (torch::Tensor& parameter : master->parameters()) parameter += 0x1p-10;  // each alone is rounded away
    }
    working.Refresh();
  }
  ExpectAll(working.network(), 1 + 0x1p-7);
}

TEST(WorkingNetworkTest, TheCopyChangesOnlyWhenItIsRefreshed) {
  PointModel master(TinyOptions());
  Fill(master, 1);
  WorkingNetwork working(master, torch::kBFloat16);
  Fill(master, 2);
  ExpectAll(working.network(), 1);
  working.Refresh();
  ExpectAll(working.network(), 2);
}

TEST(WorkingNetworkTest, GradientsAddUpInTheMastersPrecision) {
  PointModel master(TinyOptions());
  WorkingNetwork working(master, torch::kBFloat16);
  SetGradients(working.network(), 256);
  working.CollectGradients();
  ExpectGradients(master, 256);
  for (const torch::Tensor& parameter : working.network().parameters()) {
    EXPECT_FALSE(parameter.grad().defined()) << "what was handed over would be handed over again";
  }
  SetGradients(working.network(), 1);
  working.CollectGradients();
  ExpectGradients(master, 257);  // bfloat16 has no number between 256 and 258
  working.CollectGradients();
  ExpectGradients(master, 257);
}

TEST(WorkingNetworkTest, ParametersThatTookNoPartGetNoGradient) {
  PointModel master(TinyOptions());
  WorkingNetwork working(master, torch::kBFloat16);
  working.network().parameters()[1].mutable_grad() = torch::ones_like(working.network().parameters()[1]);
  working.CollectGradients();
  const std::vector<torch::Tensor> parameters = master->parameters();
  for (size_t i = 0; i < parameters.size(); ++i) EXPECT_EQ(parameters[i].grad().defined(), i == 1) << i;
}

}  // namespace
}  // namespace holdfast
