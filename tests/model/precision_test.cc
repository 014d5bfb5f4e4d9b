// SPDX-License-Identifier: Apache-2.0
#include "model/precision.h"

#include <ATen/Context.h>
#include <gtest/gtest.h>

#include <cstdlib>

namespace holdfast {
namespace {

constexpr int kFaster = 10, kSlower = 11;

// oneDNN chooses once a process: every question is asked in a process of its own, which must not return.
[[noreturn]] void ExitWithAnswer(const char* instruction_set) {
  setenv("ONEDNN_MAX_CPU_ISA", instruction_set, 1);
  std::_Exit(ComputesBFloat16Faster(c10::Device("cpu")) ? kFaster : kSlower);
}

bool ProcessorHasBFloat16() {
#if defined(__x86_64__) && defined(__GNUC__)
  return __builtin_cpu_supports("avx512bf16") != 0;
#else
  return false;
#endif
}

class PrecisionDeathTest : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override { GTEST_FLAG_SET(death_test_style, "threadsafe"); }
};

using HiddenInstructionsDeathTest = PrecisionDeathTest;
using AllowedInstructionsDeathTest = PrecisionDeathTest;

TEST_P(HiddenInstructionsDeathTest, BFloat16IsNotFasterWithoutItsInstructions) {
  EXPECT_EXIT(ExitWithAnswer(GetParam()), ::testing::ExitedWithCode(kSlower), "");
}

TEST_P(AllowedInstructionsDeathTest, BFloat16IsFasterExactlyWhereTheProcessorHasIt) {
  EXPECT_EXIT(ExitWithAnswer(GetParam()), ::testing::ExitedWithCode(ProcessorHasBFloat16() ? kFaster : kSlower), "");
}

INSTANTIATE_TEST_SUITE_P(Sets, HiddenInstructionsDeathTest,
                         ::testing::Values("SSE41", "AVX", "AVX2", "AVX512_CORE", "AVX512_CORE_VNNI"));
INSTANTIATE_TEST_SUITE_P(Sets, AllowedInstructionsDeathTest, ::testing::Values("AVX512_CORE_BF16", "ALL"));

TEST(PrecisionTest, BFloat16IsNotFasterOnADeviceThatIsNotThere) {
  if (at::hasCUDA()) GTEST_SKIP() << "there is a GPU";
  EXPECT_FALSE(ComputesBFloat16Faster(c10::Device("cuda")));
  EXPECT_FALSE(ComputesBFloat16Faster(c10::Device("cuda:1")));
}

}  // namespace
}  // namespace holdfast
