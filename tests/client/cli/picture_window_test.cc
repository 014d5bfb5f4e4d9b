// SPDX-License-Identifier: Apache-2.0
#include "client/cli/picture_window.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

// The window itself: tests/e2e/show_test.py, where there is a display.
TEST(PictureWindowTest, SaysThatThereIsNoDisplayOrThatItCannotBeReached) {
  unsetenv("WAYLAND_DISPLAY");
  unsetenv("DISPLAY");
  EXPECT_THAT(OpenPictureWindow("", [] {}),
              StatusIs(absl::StatusCode::kUnavailable, AllOf(HasSubstr("--show: "), HasSubstr("no display"))));
  setenv("DISPLAY", ":4711", /*overwrite=*/1);
  EXPECT_THAT(OpenPictureWindow("", [] {}),
              StatusIs(absl::StatusCode::kUnavailable, AllOf(HasSubstr("--show: "), HasSubstr(":4711"))));
  unsetenv("DISPLAY");
}

}  // namespace
}  // namespace holdfast
