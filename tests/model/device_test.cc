// SPDX-License-Identifier: Apache-2.0
#include "model/device.h"

#include <ATen/Context.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

TEST(DeviceTest, NamesThatNoDeviceHasAreRefused) {
  for (const char* name : {"", "abacus", "cuda:99"}) {
    EXPECT_THAT(OpenDevice(name), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("there is no device")));
  }
}

TEST(DeviceTest, Float32IsComputedInFull) {
  at::globalContext().setAllowTF32CuDNN(true);
  at::globalContext().setAllowTF32CuBLAS(true);
  EXPECT_THAT(OpenDevice("cpu"), IsOk());
  EXPECT_FALSE(at::globalContext().allowTF32CuDNN());
  EXPECT_FALSE(at::globalContext().allowTF32CuBLAS());
}

TEST(DeviceTest, TheProcessorIsNotWaitedFor) { AwaitDevice(c10::Device("cpu")); }

}  // namespace
}  // namespace holdfast
