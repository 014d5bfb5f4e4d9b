// SPDX-License-Identifier: Apache-2.0
// In every program of libFuzzer: what a target expects is a find, like a crash.
#include <gtest/gtest.h>

#include <cstdlib>

namespace holdfast {
namespace {

// libFuzzer keeps the input of a program that aborts; of a breakpoint, which is googletest's own way, it knows nothing.
class AbortOnFailure final : public ::testing::EmptyTestEventListener {
  void OnTestPartResult(const ::testing::TestPartResult& result) override {
    if (result.failed()) std::abort();
  }
};

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  ::testing::UnitTest::GetInstance()->listeners().Append(new holdfast::AbortOnFailure);
  return 0;
}
