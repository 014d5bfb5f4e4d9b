// SPDX-License-Identifier: Apache-2.0
#include "training/gradient.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>

#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// This process and another one whose vector is 'other'; or, with a failure, one that has died.
class PairedGroup final : public ProcessGroup {
 public:
  explicit PairedGroup(torch::Tensor other, absl::Status failure = absl::OkStatus())
      : other_(std::move(other)), failure_(std::move(failure)) {}

  int64_t rank() const override { return 0; }
  int64_t world() const override { return 2; }
  absl::Status Sum(torch::Tensor& tensor) override {
    ++exchanges;
    if (failure_.ok()) tensor += other_;
    return failure_;
  }
  absl::Status Broadcast(torch::Tensor&) override { return failure_; }

  int exchanges = 0;

 private:
  const torch::Tensor other_;
  const absl::Status failure_;
};

torch::Tensor Parameter(const std::vector<int64_t>& shape, const torch::Tensor& gradient) {
  torch::Tensor parameter = torch::zeros(shape, torch::requires_grad());
  if (gradient.defined()) parameter.mutable_grad() = gradient;
  return parameter;
}

TEST(GradientTest, SumsOverTheProcessesAreScaledAndTheNumbersBesideThemAreNot) {
  const torch::Tensor a = Parameter({2}, torch::tensor({1.0f, 2.0f}));
  const torch::Tensor b = Parameter({2, 2}, torch::tensor({{3.0f, 4.0f}, {5.0f, 6.0f}}));
  PairedGroup group(torch::tensor({10.0f, 20.0f, 30.0f, 40.0f, 50.0f, 60.0f, 0.25f, 1.0f}));
  std::vector<double> extra = {0.5, 7};
  const auto gradient = SumGradients({a, b}, 0.5, group, extra);
  ASSERT_THAT(gradient, IsOk());
  EXPECT_TRUE(torch::equal(*gradient, torch::tensor({5.5f, 11.0f, 16.5f, 22.0f, 27.5f, 33.0f})));
  EXPECT_TRUE(torch::equal(a.grad(), torch::tensor({5.5f, 11.0f})));
  EXPECT_TRUE(torch::equal(b.grad(), torch::tensor({{16.5f, 22.0f}, {27.5f, 33.0f}})));
  EXPECT_THAT(extra, ElementsAre(0.75, 8));
  EXPECT_EQ(group.exchanges, 1) << "a second round trip at every step";
}

TEST(GradientTest, EveryGradientIsAViewOfTheWhole) {
  const torch::Tensor a = Parameter({1}, torch::tensor({1.0f})), b = Parameter({2}, torch::tensor({2.0f, 3.0f}));
  PairedGroup group(torch::zeros({3}));
  std::vector<double> extra;
  const auto gradient = SumGradients({a, b}, 1, group, extra);
  ASSERT_THAT(gradient, IsOk());
  gradient->mul_(10);
  EXPECT_TRUE(torch::equal(a.grad(), torch::tensor({10.0f})));
  EXPECT_TRUE(torch::equal(b.grad(), torch::tensor({20.0f, 30.0f})));
}

TEST(GradientTest, ParametersWithoutAGradientTakeNoPart) {
  const torch::Tensor none = Parameter({3}, {}), a = Parameter({2}, torch::tensor({1.0f, 2.0f}));
  const torch::Tensor last = Parameter({1}, torch::tensor({4.0f}));
  PairedGroup group(torch::zeros({4}));
  std::vector<double> extra = {7};
  const auto gradient = SumGradients({none, a, none, last}, 0.5, group, extra);
  ASSERT_THAT(gradient, IsOk());
  EXPECT_TRUE(torch::equal(*gradient, torch::tensor({0.5f, 1.0f, 2.0f})));
  EXPECT_FALSE(none.grad().defined());
  EXPECT_TRUE(torch::equal(last.grad(), torch::tensor({2.0f})));
}

TEST(GradientTest, MemoryThatIsNotInOrderDoesNotMixTheNumbersUp) {
  const torch::Tensor a = Parameter({2, 3}, torch::tensor({{1.0f, 4.0f}, {2.0f, 5.0f}, {3.0f, 6.0f}}).t());
  PairedGroup group(torch::zeros({6}));
  std::vector<double> extra;
  const auto gradient = SumGradients({a}, 1, group, extra);
  ASSERT_THAT(gradient, IsOk());
  EXPECT_TRUE(torch::equal(*gradient, torch::tensor({1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f})));
  EXPECT_TRUE(torch::equal(a.grad(), torch::tensor({{1.0f, 2.0f, 3.0f}, {4.0f, 5.0f, 6.0f}})));
}

TEST(GradientTest, AProcessThatDiedLeavesTheNumbersAsTheyAre) {
  const torch::Tensor a = Parameter({2}, torch::tensor({1.0f, 2.0f}));
  PairedGroup group({}, absl::UnavailableError("rank 1 is gone"));
  std::vector<double> extra = {7};
  EXPECT_THAT(SumGradients({a}, 0.5, group, extra), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("rank 1")));
  EXPECT_TRUE(torch::equal(a.grad(), torch::tensor({1.0f, 2.0f})));
  EXPECT_THAT(extra, ElementsAre(7));
}

TEST(GradientTest, TheNextStepStartsFromNothing) {
  const torch::Tensor a = Parameter({2}, torch::tensor({1.0f, 2.0f})), none = Parameter({3}, {});
  ClearGradients({a, none});
  EXPECT_FALSE(a.grad().defined()) << "zeros would make an unused parameter take part";
  (a * torch::tensor({3.0f, 4.0f})).sum().backward();
  EXPECT_TRUE(torch::equal(a.grad(), torch::tensor({3.0f, 4.0f})));
}

TEST(GradientTest, ClippingShortensWhatIsTooLongAndKeepsTheDirection) {
  torch::Tensor gradient = torch::tensor({3.0f, 4.0f});
  EXPECT_DOUBLE_EQ(ClipGradient(gradient, 5), 5);
  EXPECT_TRUE(torch::equal(gradient, torch::tensor({3.0f, 4.0f}))) << "exactly as long as it may be";
  EXPECT_DOUBLE_EQ(ClipGradient(gradient, 1), 5);
  EXPECT_TRUE(torch::allclose(gradient, torch::tensor({0.6f, 0.8f})));
  EXPECT_NEAR(ClipGradient(gradient, 2), 1, 1e-6);
  EXPECT_TRUE(torch::allclose(gradient, torch::tensor({0.6f, 0.8f}))) << "short ones are not made longer";
}

TEST(GradientTest, ANormThatIsNoNumberIsToldSoThatAGuardSeesIt) {
  torch::Tensor nan = torch::tensor({1.0f, std::nanf("")});
  EXPECT_TRUE(std::isnan(ClipGradient(nan, 1)));
  torch::Tensor infinite = torch::tensor({1.0f, std::numeric_limits<float>::infinity()});
  EXPECT_TRUE(std::isinf(ClipGradient(infinite, 1)));
}

}  // namespace
}  // namespace holdfast
