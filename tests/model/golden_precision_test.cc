// SPDX-License-Identifier: Apache-2.0
// The whole published run in double precision, where this network and the published one differ by the latter's rounding
// only. It takes the plain ATen operations, so it also proves the way of devices without kernels.
#include <gtest/gtest.h>

#include "model/point_model.h"
#include "tests/support/golden.h"

namespace holdfast {
namespace {

TEST(GoldenPrecisionTest, WholeRunFollowsThePublishedOneInDouble) {
  const torch::NoGradGuard no_grad;
  const TensorMap golden = ReadGolden("pips2_golden.safetensors");
  PointModel model = FormulaModel(PublishedOptions());
  model->to(torch::kDouble);
  const torch::Tensor maps = model->Encode(golden.at("frames").narrow(0, 0, 24));
  EXPECT_LE(Measure("double_fmap_frame23", maps[23], golden.at("fmap_frame23")).max, 2e-5);
  const torch::Tensor start = (golden.at("queries_xy") / 8).unsqueeze(1).repeat({1, 24, 1});
  const auto trajectory = model->Unroll(maps, start, 6);
  const auto image = [&](size_t k) { return (trajectory.positions[k] * 8).transpose(0, 1); };
  const auto moving = [](const torch::Tensor& xy) { return xy.narrow(0, 1, 23); };  // all but the locked frame
  EXPECT_LE(Measure("double_coords_iter0", moving(image(0)), moving(golden.at("coords_iter0"))).max, 1e-3);
  const auto locked = Measure("double_coords_iter5", moving(image(5)), moving(golden.at("coords_iter5")));
  EXPECT_LE(locked.max, 0.1);
  EXPECT_LE(locked.mean, 0.01);
  const auto unlocked = Measure("double_pred_iter5_unlocked", image(5), golden.at("pred_iter5_unlocked"));
  EXPECT_LE(unlocked.max, 0.1);
  EXPECT_LE(unlocked.mean, 0.01);
}

}  // namespace
}  // namespace holdfast
