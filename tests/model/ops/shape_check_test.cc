// SPDX-License-Identifier: Apache-2.0
#include "model/ops/shape_check.h"

#include <gmock/gmock.h>
#include <torch/types.h>

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string MessageOf(const std::function<void()>& check) {
  try {
    check();
  } catch (const c10::Error& error) {
    return error.what_without_backtrace();
  }
  return "no error";
}

TEST(ShapeCheckTest, AMatchingTensorPasses) {
  EXPECT_NO_THROW(CheckTensor("xy", torch::zeros({5, 2}), {5, 2}));
  EXPECT_NO_THROW(CheckTensor("xy", torch::zeros({5, 2}), {-1, 2}));
  EXPECT_NO_THROW(CheckTensor("rgb", torch::zeros({4, 4, 3}, torch::kUInt8), {-1, -1, 3}, torch::kUInt8));
  EXPECT_NO_THROW(CheckFloating("map", torch::zeros({2}, torch::kBFloat16), {2}));
}

TEST(ShapeCheckTest, TheMessageHasTheNameTheShapeGotAndTheShapeWanted) {
  EXPECT_THAT(MessageOf([] {
                CheckTensor("start", torch::zeros({5, 3}), {-1, 2});
              }),
              AllOf(HasSubstr("start: got [5, 3] Float"), HasSubstr("wanted [*, 2] Float")));
  EXPECT_THAT(MessageOf([] { CheckTensor("start", torch::zeros({5}), {5, 2}); }), HasSubstr("got [5] Float"));
}

TEST(ShapeCheckTest, AnotherDtypeAndAnUndefinedTensorAreRefused) {
  EXPECT_THAT(MessageOf([] { CheckTensor("rgb", torch::zeros({2}), {2}, torch::kUInt8); }),
              AllOf(HasSubstr("Float"), HasSubstr("Byte")));
  EXPECT_THAT(MessageOf([] { CheckTensor("rgb", torch::Tensor(), {2}); }), HasSubstr("an undefined tensor"));
  EXPECT_THAT(MessageOf([] { CheckFloating("map", torch::zeros({2}, torch::kLong), {2}); }),
              HasSubstr("of a floating-point dtype"));
}

}  // namespace
}  // namespace holdfast
