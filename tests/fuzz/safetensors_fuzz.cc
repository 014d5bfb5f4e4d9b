// SPDX-License-Identifier: Apache-2.0
// The reader of weights: the input is a safetensors file. What it takes can be written, and is read as the same.
#include "model/checkpoint/safetensors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>

#include "tests/fuzz/fuzz_input.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

void ExpectSame(const TensorFile& a, const TensorFile& b) {
  EXPECT_EQ(a.metadata, b.metadata);
  EXPECT_EQ(a.tensors.size(), b.tensors.size());
  for (const auto& [name, tensor] : a.tensors) {
    const auto found = b.tensors.find(name);
    ASSERT_NE(found, b.tensors.end());
    EXPECT_EQ(tensor.sizes(), found->second.sizes());
    EXPECT_EQ(tensor.scalar_type(), found->second.scalar_type());
  }
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto file = holdfast::ParseSafetensors(holdfast::FuzzInput(data, size).TakeRest());
  if (!file.ok()) return 0;
  const auto bytes = holdfast::SerializeSafetensors(*file);
  EXPECT_THAT(bytes, holdfast::IsOk());
  const auto again = holdfast::ParseSafetensors(*bytes);
  EXPECT_THAT(again, holdfast::IsOk());
  holdfast::ExpectSame(*file, *again);
  return 0;
}
