// SPDX-License-Identifier: Apache-2.0
#include "server/signals.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

namespace holdfast {
namespace {

using ::testing::ExitedWithCode;

class SignalsDeathTest : public ::testing::Test {
 protected:
  SignalsDeathTest() { ::testing::FLAGS_gtest_death_test_style = "threadsafe"; }
};

TEST_F(SignalsDeathTest, TheFirstSignalIsWaitedFor) {
  const auto wait_for = [](int signal) {
    const TerminationSignals signals;
    kill(getpid(), signal);
    signals.Wait();
    _exit(0);
  };
  EXPECT_EXIT(wait_for(SIGTERM), ExitedWithCode(0), "");
  EXPECT_EXIT(wait_for(SIGINT), ExitedWithCode(0), "");
}

TEST_F(SignalsDeathTest, TheSecondSignalEndsTheProcess) {
  const auto signal_twice = [] {
    const TerminationSignals signals;
    kill(getpid(), SIGTERM);
    signals.Wait();
    kill(getpid(), SIGTERM);
    while (true) pause();
  };
  EXPECT_EXIT(signal_twice(), ExitedWithCode(128 + SIGTERM), "");
}

TEST_F(SignalsDeathTest, GoingAwayWithoutASignalDoesNotHang) { const TerminationSignals signals; }

}  // namespace
}  // namespace holdfast
