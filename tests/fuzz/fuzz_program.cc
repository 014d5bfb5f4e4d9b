// SPDX-License-Identifier: Apache-2.0
// In every program of libFuzzer: what a target expects is a find, like a crash.
#include <gtest/gtest.h>

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  GTEST_FLAG_SET(break_on_failure, true);
  return 0;
}
