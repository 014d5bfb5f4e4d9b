// SPDX-License-Identifier: Apache-2.0
#include "client/interrupt.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>

#include "absl/synchronization/notification.h"

namespace holdfast {
namespace {

TEST(StopSignalTest, TheCallbackRunsOnceAndNotAfterItIsTakenAway) {
  StopSignal stop;
  int calls = 0;
  stop.SetCallback([&calls] { ++calls; });
  EXPECT_FALSE(stop.stopped());
  stop.Stop();
  stop.Stop();
  EXPECT_TRUE(stop.stopped());
  EXPECT_EQ(calls, 1);

  StopSignal other;
  other.SetCallback([&calls] { ++calls; });
  other.SetCallback(nullptr);
  other.Stop();
  EXPECT_EQ(calls, 1);
}

TEST(StopSignalTest, ACallbackThatComesLateRunsAtOnce) {
  StopSignal stop;
  stop.Stop();
  bool called = false;
  stop.SetCallback([&called] { called = true; });
  EXPECT_TRUE(called);
}

TEST(InterruptWatcherTest, AnInterruptStopsInsteadOfKilling) {
  StopSignal stop;
  absl::Notification stopped;
  stop.SetCallback([&stopped] { stopped.Notify(); });
  const InterruptWatcher watcher(stop);
  kill(getpid(), SIGINT);
  stopped.WaitForNotification();
  EXPECT_TRUE(stop.stopped());
}

TEST(InterruptWatcherTest, ASecondInterruptEndsTheProcess) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        StopSignal stop;
        stop.Stop();
        const InterruptWatcher watcher(stop);
        kill(getpid(), SIGINT);
        absl::Notification().WaitForNotification();
      },
      ::testing::ExitedWithCode(130), "");
}

}  // namespace
}  // namespace holdfast
