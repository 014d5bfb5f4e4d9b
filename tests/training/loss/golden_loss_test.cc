// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include "tests/support/golden.h"
#include "training/loss/losses.h"

namespace holdfast {
namespace {

TEST(GoldenLossTest, EqualsThePublishedSequenceLossOnItsSixPredictions) {
  torch::NoGradGuard no_grad;
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  PointModel model = FormulaModel(PublishedOptions());
  const torch::Tensor maps = model->Encode(golden.at("frames").narrow(0, 0, 24));
  const torch::Tensor start = (golden.at("queries_xy") / 8).unsqueeze(1).expand({-1, 24, -1}).contiguous();
  ClipTargets targets;
  targets.tracks = golden.at("gt").transpose(0, 1);
  targets.visible = golden.at("vis").t() > 0;
  targets.valid = golden.at("valid").t() > 0;
  std::vector<torch::Tensor> positions;
  for (const torch::Tensor& xy : model->Unroll(maps, start, 6).positions) positions.push_back(xy * 8);
  LossOptions options;
  options.form = DistanceForm::kPublished;
  const double loss = DistanceLoss(positions, targets, options).item<double>();
  const double expected = golden.at("sequence_loss_gamma08").item<double>();
  RecordProperty("relative_error", std::to_string(std::abs(loss / expected - 1)));
  EXPECT_NEAR(loss / expected, 1, 1e-3) << loss << " instead of " << expected;
}

}  // namespace
}  // namespace holdfast
