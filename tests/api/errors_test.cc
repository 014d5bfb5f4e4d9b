// SPDX-License-Identifier: Apache-2.0
#include "api/errors.h"

#include <gtest/gtest.h>

namespace holdfast {
namespace {

TEST(ErrorsTest, WhatAClientDidIsNotTheServersFault) {
  EXPECT_FALSE(IsServersFault(absl::OkStatus()));
  EXPECT_FALSE(IsServersFault(InvalidFieldError("config", "is empty")));
  EXPECT_FALSE(IsServersFault(absl::CancelledError("went away")));
  EXPECT_FALSE(IsServersFault(absl::DeadlineExceededError("nothing came")));
  EXPECT_FALSE(IsServersFault(absl::FailedPreconditionError("other weights")));
}

TEST(ErrorsTest, AServerThatEndsHasNoFault) { EXPECT_FALSE(IsServersFault(absl::UnavailableError("going away"))); }

TEST(ErrorsTest, AQuotaIsNoFaultButMemoryThatIsNotThereIs) {
  EXPECT_FALSE(IsServersFault(OverloadError("sessions", "all taken", absl::Seconds(1))));
  EXPECT_TRUE(IsServersFault(absl::ResourceExhaustedError("out of memory")));
}

TEST(ErrorsTest, WhatNobodyForesawIsTheServersFault) {
  EXPECT_TRUE(IsServersFault(absl::InternalError("an operator threw")));
  EXPECT_TRUE(IsServersFault(absl::UnknownError("")));
}

}  // namespace
}  // namespace holdfast
