// SPDX-License-Identifier: Apache-2.0
// The published network's numbers, stage by stage from golden inputs and as whole runs.
#include <gtest/gtest.h>

#include "model/checkpoint/checkpoint.h"
#include "model/contextual_attention.h"
#include "model/ops/correlation.h"
#include "model/ops/feature_views.h"
#include "model/ops/sampling.h"
#include "model/point_model.h"
#include "model/refinement.h"
#include "model/update_block.h"
#include "tests/support/golden.h"
#include "tests/support/source_tree.h"

namespace holdfast {
namespace {

constexpr int64_t kWindow = 24;
constexpr double kStride = 8;

// Loaded and encoded once for all tests.
class GoldenTest : public testing::Test {
 protected:
  struct Shared {
    TensorMap golden = ReadGolden("pips2_golden.safetensors");
    PointModel model = FormulaModel(PublishedOptions());
    torch::Tensor maps;  // [47, 128, 16, 20]
    std::vector<FeaturePyramid> pyramids;
  };

  static void SetUpTestSuite() {
    shared_ = new Shared;
    const c10::InferenceMode guard;
    shared_->maps = shared_->model->Encode(shared_->golden.at("frames"));
    shared_->pyramids = BuildPyramids(shared_->maps, shared_->model->options().correlation_levels);
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }

  static const torch::Tensor& Golden(const std::string& name) { return shared_->golden.at(name); }

  // Windows of the clip: frames first .. first + 23.
  static std::vector<FeaturePyramid> Frames(int64_t first) {
    return {shared_->pyramids.begin() + first, shared_->pyramids.begin() + first + kWindow};
  }
  // [S, N, 2] image pixels as the golden files have them <-> [N, S, 2] feature pixels.
  static torch::Tensor ToFeatures(const torch::Tensor& xy) { return (xy / kStride).transpose(0, 1).contiguous(); }
  static torch::Tensor ToImage(const torch::Tensor& xy) { return (xy * kStride).transpose(0, 1); }

  static torch::Tensor QueryFeature() {
    return SampleFeatures(shared_->pyramids.front(), Golden("queries_xy") / kStride);
  }
  static WindowRows FirstWindow() {
    WindowRows rows;
    rows.frames = Frames(0);
    rows.start = (Golden("queries_xy") / kStride).unsqueeze(1).repeat({1, kWindow, 1});
    rows.feature = QueryFeature();
    return rows;
  }
  static WindowEstimate Run(const WindowRows& rows, int64_t iterations) {
    return shared_->model->Refine({rows}, {iterations, /*keep_templates=*/true}).front();
  }
  // Inputs of iteration k + 1 are exact: they come from the golden positions of iteration k.
  static torch::Tensor CorrelationsAt(const torch::Tensor& xy, bool first) {
    PyramidCells window = BuildCells(shared_->maps.narrow(0, 0, kWindow), 4);
    const torch::Tensor feature = QueryFeature().unsqueeze(1).expand({-1, kWindow, -1});
    const torch::Tensor templates = first ? feature.unsqueeze(2) : StackTemplates(feature, SampleRows(window, xy));
    return JoinTemplates(Correlate(window, templates, xy, 3));
  }

  static Shared* shared_;
};
GoldenTest::Shared* GoldenTest::shared_ = nullptr;

TEST_F(GoldenTest, EncoderGivesThePublishedFeatureMaps) {
  EXPECT_LE(Measure("fmap_frame0", shared_->maps[0], Golden("fmap_frame0")).max, 1e-4);
  EXPECT_LE(Measure("fmap_frame23", shared_->maps[23], Golden("fmap_frame23")).max, 1e-4);
}

TEST_F(GoldenTest, TrainingEncoderGivesThePublishedFeatureMaps) {
  const torch::Tensor maps = shared_->model->Encode(Golden("frames").narrow(0, 0, 2));
  ASSERT_TRUE(maps.requires_grad());
  EXPECT_LE(Measure("fmap_frame0_training", maps[0].detach(), Golden("fmap_frame0")).max, 1e-4);
}

TEST_F(GoldenTest, CorrelationsMatchFromGoldenPositions) {
  const c10::InferenceMode guard;
  const torch::Tensor start = FirstWindow().start;
  EXPECT_LE(Measure("corr_iter0", CorrelationsAt(start, true), Golden("corr_iter0")).max, 1e-4);
  const torch::Tensor third = ToFeatures(Golden("coords_iter2"));
  EXPECT_LE(Measure("corr_iter3", CorrelationsAt(third, false), Golden("corr_iter3")).max, 1e-4);
}

TEST_F(GoldenTest, UpdateBlockMatchesFromGoldenCorrelations) {
  const c10::InferenceMode guard;
  UpdateBlock block(shared_->model->options());
  FillByFormula(*block, "delta_block.");
  const torch::Tensor first = block->forward(Golden("corr_iter0"), FirstWindow().start);
  EXPECT_LE(Measure("delta_iter0", first, Golden("delta_iter0")).max, 1e-4);
  const torch::Tensor third = block->forward(Golden("corr_iter3"), ToFeatures(Golden("coords_iter2")));
  EXPECT_LE(Measure("delta_iter3", third, Golden("delta_iter3")).max, 1e-4);
}

TEST_F(GoldenTest, TemplatesMatchFromGoldenPositions) {
  const c10::InferenceMode guard;
  const PyramidCells window = BuildCells(shared_->maps.narrow(0, 0, kWindow), 4);
  const torch::Tensor xy = ToFeatures(Golden("coords_iter4"));
  const torch::Tensor feature = QueryFeature().unsqueeze(1).expand({-1, kWindow, -1});
  const torch::Tensor templates = StackTemplates(feature, SampleRows(window, xy)).narrow(0, 0, 2).transpose(0, 1);
  EXPECT_LE(Measure("feats1", templates.select(2, 0), Golden("feats1")).max, 1e-4);
  EXPECT_LE(Measure("feats2", templates.select(2, 1), Golden("feats2")).max, 1e-4);
  EXPECT_LE(Measure("feats4", templates.select(2, 2), Golden("feats4")).max, 1e-4);
}

// Random weights are chaotic: rounding grows about fivefold an iteration, and the golden numbers themselves, made in
// float32, are 0.08 pixels from exact ones after six. Most of our own comes from the update block's convolutions: with
// these alone in double the largest difference falls from 0.23 to 0.10. The bounds leave room for that;
// golden_precision_test runs all of it in double and is held to tighter ones.
TEST_F(GoldenTest, WholeRunFollowsThePublishedOne) {
  EXPECT_LE(Measure("coords_iter0", ToImage(Run(FirstWindow(), 1).positions), Golden("coords_iter0")).max, 1e-3);
  const auto fourth = Measure("coords_iter3", ToImage(Run(FirstWindow(), 4).positions), Golden("coords_iter3"));
  EXPECT_LE(fourth.max, 0.1);
  EXPECT_LE(fourth.mean, 0.01);
  const auto last = Measure("coords_iter5", ToImage(Run(FirstWindow(), 6).positions), Golden("coords_iter5"));
  EXPECT_LE(last.max, 0.4);
  EXPECT_LE(last.mean, 0.02);
}

TEST_F(GoldenTest, UnrollReturnsThePublishedUnlockedPredictions) {
  const torch::NoGradGuard no_grad;
  const auto trajectory = shared_->model->Unroll(shared_->maps.narrow(0, 0, kWindow), FirstWindow().start, 6);
  ASSERT_EQ(trajectory.positions.size(), 6u);
  EXPECT_FALSE(trajectory.visibility_logit.defined());
  const auto difference =
      Measure("pred_iter5_unlocked", ToImage(trajectory.positions.back()), Golden("pred_iter5_unlocked"));
  EXPECT_LE(difference.max, 0.4);
  EXPECT_LE(difference.mean, 0.02);
}

// Windows of 24 that overlap in one frame, the last one shifted back to end on the last frame; templates carried on.
TEST_F(GoldenTest, ChainedRunFollowsThePublishedScript) {
  const c10::InferenceMode guard;
  const int64_t frames = 47;
  torch::Tensor track = torch::zeros({8, frames, 2});
  WindowRows rows = FirstWindow();
  track.narrow(1, 0, kWindow).copy_(rows.start);
  int64_t first = 0;
  while (true) {
    rows.frames = Frames(first);
    rows.start = track.narrow(1, first, kWindow).clone();
    const WindowEstimate estimate = Run(rows, 4);
    track.narrow(1, first, kWindow).copy_(estimate.positions);
    rows.carried_f2 = estimate.f2;
    rows.carried_f4 = estimate.f4;
    if (first + kWindow == frames) break;
    const int64_t known = first + kWindow;
    first = std::min(first + kWindow - 1, frames - kWindow);
    track.narrow(1, known, first + kWindow - known).copy_(track.narrow(1, known - 1, 1));
  }
  const auto difference = Measure("chained_47_iters4", ToImage(track), Golden("chained_47_iters4"));
  EXPECT_LE(difference.max, 1.0);
  EXPECT_LE(difference.mean, 0.05);
}

TEST(InterimWeightsTest, TrackAsExpected) {
  auto loaded = LoadModel(InSourceTree("tests/data/interim.safetensors"));
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  PointModel model = loaded->model;
  const c10::InferenceMode guard;
  const TensorMap clip = ReadGolden("pips2_golden.safetensors");
  const TensorMap expected = ReadGolden("interim_expected.safetensors");
  const torch::Tensor maps = model->Encode(clip.at("frames").narrow(0, 0, kWindow));
  EXPECT_LE(Measure("interim_fmap_frame0", maps[0], expected.at("fmap_frame0")).max, 1e-4);
  const torch::Tensor queries = clip.at("queries_xy") / kStride;
  WindowRows rows;
  rows.frames = BuildPyramids(maps, model->options().correlation_levels);
  rows.start = queries.unsqueeze(1).repeat({1, kWindow, 1});
  rows.feature = SampleFeatures(rows.frames.front(), queries);
  const torch::Tensor got = model->Refine({rows}, {4, false}).front().positions * kStride;
  EXPECT_LE(Measure("interim_coords_iter3", got.transpose(0, 1), expected.at("coords_iter3")).max, 1e-3);
}

TEST(ContextGoldenTest, ContextualAttentionMatchesThePlainImplementation) {
  const c10::InferenceMode guard;
  const TensorMap golden = ReadGolden("context_golden.safetensors");
  ContextualAttention context(ModelOptions{});
  FillByFormula(*context, "context.");
  const torch::Tensor input = ReadGolden("pips2_golden.safetensors").at("fmap_frame0").unsqueeze(0);
  torch::Tensor x = input.contiguous(torch::MemoryFormat::ChannelsLast);
  const auto blocks = context->named_children()["blocks"]->children();
  for (size_t i = 0; i < blocks.size(); ++i) {
    x = blocks[i]->as<ContextBlock>()->forward(x);
    if (i == 0) {
      EXPECT_LE(Measure("context_after_block0", x[0], golden.at("after_block0")).max, 1e-4);
    }
  }
  EXPECT_LE(Measure("context_after_block5", x[0], golden.at("after_block5")).max, 1e-4);
  EXPECT_LE(Measure("context_after_norm", context->forward(input)[0], golden.at("after_norm")).max, 1e-4);
}

TEST(ParameterCountTest, EqualsThePublishedNumbers) {
  EXPECT_EQ(PointModel(PublishedOptions())->ParameterCount(), 17'565'410);
  EXPECT_EQ(PointModel(ModelOptions{})->ParameterCount(), 18'656'226);
}

}  // namespace
}  // namespace holdfast
