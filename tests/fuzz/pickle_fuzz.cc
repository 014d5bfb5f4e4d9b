// SPDX-License-Identifier: Apache-2.0
// The pickle machine: the input is a pickle.
#include "model/torch_import/pickle.h"

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto document = holdfast::ReadPickle(holdfast::FuzzInput(data, size).TakeRest());
  if (document.ok()) {
    EXPECT_NE((*document)->root, nullptr);
  }
  return 0;
}
