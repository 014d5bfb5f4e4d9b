// SPDX-License-Identifier: Apache-2.0
#include "model/point_model.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <set>
#include <vector>

#include "model/ops/sampling.h"
#include "model/update_block.h"
#include "tests/support/golden.h"
#include "tests/support/networks.h"

namespace holdfast {
namespace {

torch::Tensor Pictures(int64_t frames) {
  torch::manual_seed(23);
  return torch::randint(0, 256, {frames, 64, 72, 3}, torch::kUInt8);
}

// One thread while it lives.
class OneThread {
 public:
  OneThread() : threads_(torch::get_num_threads()) { torch::set_num_threads(1); }
  ~OneThread() { torch::set_num_threads(threads_); }

 private:
  const int threads_;
};

class PointModelTest : public testing::Test {
 protected:
  WindowRows Rows(int64_t points, int64_t seed = 1) {
    torch::manual_seed(seed);
    WindowRows rows;
    rows.frames = BuildPyramids(model_->Encode(Pictures(8)), 4);
    const torch::Tensor xy = torch::rand({points, 2}) * 8;
    rows.start = xy.unsqueeze(1).repeat({1, 8, 1});
    rows.feature = SampleFeatures(rows.frames.front(), xy);
    return rows;
  }
  static WindowRows Narrow(const WindowRows& rows, int64_t first, int64_t count) {
    WindowRows result = rows;
    result.start = rows.start.narrow(0, first, count);
    result.feature = rows.feature.narrow(0, first, count);
    return result;
  }

  PointModel model_ = FormulaModel(TinyOptions());
};

TEST_F(PointModelTest, FeaturesOfAFrameDoNotDependOnItsBatch) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor pictures = Pictures(5);
  const torch::Tensor together = model_->Encode(pictures);
  EXPECT_EQ(together.sizes(), (std::vector<int64_t>{5, 16, 8, 9}));
  EXPECT_TRUE(together.is_contiguous(torch::MemoryFormat::ChannelsLast));
  EXPECT_TRUE(torch::equal(model_->Encode(pictures.narrow(0, 2, 1)), together.narrow(0, 2, 1)));
  EXPECT_TRUE(torch::equal(model_->Encode(pictures.narrow(0, 1, 3)), together.narrow(0, 1, 3)));
}

TEST_F(PointModelTest, RowsAreBitIdenticalInBatchesOfAnySize) {
  const c10::InferenceMode guard;
  const OneThread one_thread;
  const WindowRows all = Rows(64);
  const WindowEstimate want = model_->Refine({all}, {3, true}).front();
  for (const int64_t count : {1, 2, 3, 17}) {
    const int64_t first = 64 - count;
    const WindowEstimate got = model_->Refine({Narrow(all, first, count)}, {3, true}).front();
    EXPECT_TRUE(torch::equal(got.positions, want.positions.narrow(0, first, count))) << count;
    EXPECT_TRUE(torch::equal(got.visibility_logit, want.visibility_logit.narrow(0, first, count))) << count;
    EXPECT_TRUE(torch::equal(got.similarity, want.similarity.narrow(0, first, count))) << count;
    EXPECT_TRUE(torch::equal(got.f4, want.f4.narrow(0, first, count))) << count;
  }
}

TEST_F(PointModelTest, PublishedSizeIsBitIdenticalInBatchesOfAnySizeToo) {
  const c10::InferenceMode guard;
  const OneThread one_thread;
  UpdateBlock block(PublishedOptions());
  FillByFormula(*block, "delta_block.");
  torch::manual_seed(2);
  const torch::Tensor correlation = torch::randn({64, 24, 588});
  const torch::Tensor xy = torch::rand({64, 24, 2}) * 20;
  const torch::Tensor want = block->forward(correlation, xy);
  for (const int64_t count : {1, 2, 3, 17}) {
    const torch::Tensor got = block->forward(correlation.narrow(0, 5, count), xy.narrow(0, 5, count));
    EXPECT_TRUE(torch::equal(got, want.narrow(0, 5, count))) << count;
  }
}

// The longest step of each row [N] in its last iteration.
torch::Tensor LongestStep(const WindowEstimate& estimate) { return estimate.last_step.amax(1); }

TEST_F(PointModelTest, ARowThatStandsStillEndsAsIfItHadBeenGivenFewerIterations) {
  const c10::InferenceMode guard;
  const OneThread one_thread;
  const WindowRows first = Rows(9, 1), second = Rows(6, 2);
  std::vector<std::vector<WindowEstimate>> after;  // so many iterations
  for (int64_t k = 0; k <= 4; ++k) after.push_back(model_->Refine({first, second}, {k, false}));
  const torch::Tensor steps = torch::cat({LongestStep(after[1][0]), LongestStep(after[2][1])});
  const double least = steps.median().item<double>();
  const auto got = model_->Refine({first, second}, {4, false, least});
  std::set<int64_t> taken;
  for (size_t group = 0; group < 2; ++group) {
    for (int64_t row = 0; row < got[group].positions.size(0); ++row) {
      const int64_t k = got[group].iterations[row].item<int64_t>();
      taken.insert(k);
      for (int64_t before = 1; before < k; ++before) {
        EXPECT_GE(LongestStep(after[before][group])[row].item<double>(), least) << "it should have ended before";
      }
      if (k < 4) {
        EXPECT_LT(LongestStep(after[k][group])[row].item<double>(), least);
      }
      const WindowEstimate& want = after[k][group];
      EXPECT_TRUE(torch::equal(got[group].positions[row], want.positions[row])) << row;
      EXPECT_TRUE(torch::equal(got[group].visibility_logit[row], want.visibility_logit[row])) << row;
      EXPECT_TRUE(torch::equal(got[group].similarity[row], want.similarity[row])) << row;
      EXPECT_TRUE(torch::equal(got[group].last_step[row], want.last_step[row])) << row;
    }
  }
  EXPECT_GE(taken.size(), 2u) << "rows should differ, or this tries nothing";
}

TEST_F(PointModelTest, AllRowsMayEndAfterOneIterationAndKeptTemplatesLetNoneEnd) {
  const c10::InferenceMode guard;
  const WindowRows rows = Rows(4);
  const WindowEstimate got = model_->Refine({rows}, {4, false, 1e6}).front();
  EXPECT_TRUE(torch::equal(got.positions, model_->Refine({rows}, {1, false}).front().positions));
  EXPECT_TRUE(got.iterations.eq(1).all().item<bool>());
  EXPECT_TRUE(model_->Refine({rows}, {4, false}).front().iterations.eq(4).all().item<bool>());
  EXPECT_THROW(model_->Refine({rows}, {4, true, 1e6}), c10::Error);
}

TEST_F(PointModelTest, WindowsBatchedTogetherGiveWhatEachGivesAlone) {
  const c10::InferenceMode guard;
  const OneThread one_thread;
  const WindowRows first = Rows(3, 1);
  WindowRows second = Rows(5, 2);
  for (auto& frame : second.frames) frame = second.frames.back();  // one frame may stand several times
  const auto together = model_->Refine({first, second}, {2, false});
  ASSERT_EQ(together.size(), 2u);
  EXPECT_TRUE(torch::equal(together[0].positions, model_->Refine({first}, {2, false})[0].positions));
  EXPECT_TRUE(torch::equal(together[1].positions, model_->Refine({second}, {2, false})[0].positions));
  EXPECT_FALSE(together[0].f2.defined());
}

TEST_F(PointModelTest, FirstFrameStaysWhereItIs) {
  const c10::InferenceMode guard;
  const WindowRows rows = Rows(4);
  const WindowEstimate estimate = model_->Refine({rows}, {4, false}).front();
  EXPECT_TRUE(torch::equal(estimate.positions.select(1, 0), rows.start.select(1, 0)));
  EXPECT_EQ(estimate.last_step.select(1, 0).abs().max().item<float>(), 0);
  EXPECT_GT(estimate.last_step.narrow(1, 1, 7).min().item<float>(), 0);
  EXPECT_NEAR(estimate.similarity.select(1, 0).min().item<float>(), 1, 1e-5);
  EXPECT_LE(estimate.similarity.max().item<float>(), 1.00001f);
}

TEST_F(PointModelTest, CarriedTemplatesReplaceTheQueryInTheFirstIteration) {
  const c10::InferenceMode guard;
  WindowRows rows = Rows(2);
  const torch::Tensor without = model_->Refine({rows}, {1, false}).front().positions;
  rows.carried_f2 = rows.feature.unsqueeze(1).repeat({1, 8, 1});
  rows.carried_f4 = rows.carried_f2.clone();
  EXPECT_TRUE(torch::allclose(model_->Refine({rows}, {1, false}).front().positions, without, 0, 1e-5));
  rows.carried_f4.neg_();
  EXPECT_FALSE(torch::allclose(model_->Refine({rows}, {1, false}).front().positions, without, 0, 1e-3));
}

TEST_F(PointModelTest, NoIterationsLeaveTheStart) {
  const c10::InferenceMode guard;
  const WindowRows rows = Rows(2);
  EXPECT_TRUE(torch::equal(model_->Refine({rows}, {0, true}).front().positions, rows.start));
  EXPECT_TRUE(model_->Refine({}, {4, false}).empty());
}

TEST_F(PointModelTest, MalformedInputIsNamed) {
  const c10::InferenceMode guard;
  WindowRows rows = Rows(2);
  rows.start = rows.start.narrow(1, 0, 7);
  EXPECT_THROW(model_->Refine({rows}, {1, false}), c10::Error);
  EXPECT_THROW(model_->Encode(torch::zeros({1, 60, 64, 3}, torch::kUInt8)), c10::Error);
  EXPECT_THROW(model_->Encode(torch::zeros({1, 64, 64, 3})), c10::Error);
}

TEST_F(PointModelTest, HalfPrecisionFollowsFullPrecision) {
  const c10::InferenceMode guard;
  PointModel half = FormulaModel(TinyOptions());
  half->to(torch::kBFloat16);
  const torch::Tensor want = model_->Encode(Pictures(8));
  const torch::Tensor got = half->Encode(Pictures(8));
  EXPECT_EQ(got.scalar_type(), torch::kBFloat16);
  EXPECT_GT(torch::cosine_similarity(got.to(torch::kFloat32), want).min().item<float>(), 0.99f);
  WindowRows rows = Rows(6);
  rows.frames = BuildPyramids(got, 4);
  const WindowEstimate estimate = half->Refine({rows}, {1, false}).front();
  EXPECT_EQ(estimate.positions.scalar_type(), torch::kFloat32);
  EXPECT_TRUE(estimate.positions.isfinite().all().item<bool>());
  EXPECT_FALSE(torch::equal(estimate.positions, rows.start));
}

TEST_F(PointModelTest, HalfPrecisionStepsAreCloseToFullOnes) {
  const c10::InferenceMode guard;
  UpdateBlock full(PublishedOptions());
  UpdateBlock half(PublishedOptions());
  FillByFormula(*full, "delta_block.");
  FillByFormula(*half, "delta_block.");
  half->to(torch::kBFloat16);
  torch::manual_seed(2);
  const torch::Tensor correlation = torch::randn({4, 24, 588});
  const torch::Tensor xy = torch::rand({4, 24, 2}) * 20;
  const torch::Tensor want = full->forward(correlation, xy);
  const torch::Tensor got = half->forward(correlation, xy);
  EXPECT_EQ(got.scalar_type(), torch::kFloat32);
  EXPECT_LE((got - want).norm().item<float>(), 0.15f * want.norm().item<float>());
}

// The way of devices without kernels, tried in double on the CPU.
TEST_F(PointModelTest, PlainOperationsGiveTheSameWindows) {
  const torch::NoGradGuard no_grad;
  PointModel plain = FormulaModel(TinyOptions());
  plain->to(torch::kDouble);
  const WindowRows rows = Rows(5);
  const torch::Tensor want = model_->Refine({rows}, {2, false}).front().positions;
  const torch::Tensor got = plain->Unroll(plain->Encode(Pictures(8)), rows.start, 2).positions.back();
  EXPECT_LE((got - want).narrow(1, 1, 7).abs().max().item<float>(), 1e-3);
}

TEST_F(PointModelTest, UnrollEqualsRefineButForTheLock) {
  const torch::NoGradGuard no_grad;
  const WindowRows rows = Rows(5);
  const auto trajectory = model_->Unroll(model_->Encode(Pictures(8)), rows.start, 3);
  const WindowEstimate estimate = model_->Refine({rows}, {3, false}).front();
  EXPECT_LE((trajectory.positions.back() - estimate.positions).narrow(1, 1, 7).abs().max().item<float>(), 1e-4);
  EXPECT_LE((trajectory.visibility_logit - estimate.visibility_logit).abs().max().item<float>(), 1e-3);
  EXPECT_FALSE(torch::equal(trajectory.positions.back().select(1, 0), rows.start.select(1, 0)));
}

TEST_F(PointModelTest, EveryAppliedParameterReceivesAGradient) {
  model_->train();
  const torch::Tensor start = (torch::rand({4, 1, 2}) * 8).repeat({1, 8, 1});
  const auto trajectory = model_->Unroll(model_->Encode(Pictures(8)), start, 2);
  torch::Tensor loss = trajectory.visibility_logit.square().sum();
  for (const auto& positions : trajectory.positions) loss = loss + (positions - 3).square().sum();
  loss.backward();
  for (const auto& parameter : model_->named_parameters()) {
    if (parameter.key().rfind("norm.", 0) == 0) continue;  // loaded, never applied
    ASSERT_TRUE(parameter.value().grad().defined()) << parameter.key();
    EXPECT_TRUE(parameter.value().grad().isfinite().all().item<bool>()) << parameter.key();
  }
}

TEST(MotionEmbeddingTest, LastMotionIsRepeated) {
  const torch::Tensor xy = torch::tensor({0.0f, 0.0f, 1.0f, 2.0f, 4.0f, 3.0f}).view({1, 3, 2});
  const torch::Tensor embedded = EmbedMotion(xy, 8);  // two frequencies: 1 and 1 / 10000
  EXPECT_EQ(embedded.sizes(), (std::vector<int64_t>{1, 3, 10}));
  EXPECT_TRUE(torch::equal(embedded.select(1, 1), embedded.select(1, 2)));
  const float x = 3, y = 1;
  const torch::Tensor want = torch::tensor({std::sin(x), std::sin(x / 1e4f), std::cos(x), std::cos(x / 1e4f),
                                            std::sin(y), std::sin(y / 1e4f), std::cos(y), std::cos(y / 1e4f), x, y});
  EXPECT_TRUE(torch::allclose(embedded[0][1], want, 0, 1e-6));
}

}  // namespace
}  // namespace holdfast
