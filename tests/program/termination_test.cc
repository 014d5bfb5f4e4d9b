// SPDX-License-Identifier: Apache-2.0
#include "program/termination.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {
namespace {

TEST(StopSignalTest, TheCallbackRunsOnceAndNotAfterItIsTakenAway) {
  StopSignal stop;
  int calls = 0;
  stop.SetCallback([&calls] { ++calls; });
  EXPECT_FALSE(stop.stopped());
  EXPECT_EQ(stop.signal(), 0);
  EXPECT_TRUE(stop.Stop(SIGTERM));
  EXPECT_FALSE(stop.Stop()) << "it is stopped already";
  EXPECT_TRUE(stop.stopped());
  EXPECT_EQ(stop.signal(), SIGTERM);
  EXPECT_EQ(calls, 1);

  StopSignal other;
  other.SetCallback([&calls] { ++calls; });
  other.SetCallback(nullptr);
  EXPECT_FALSE(other.Stop()) << "nobody listens";
  EXPECT_TRUE(other.stopped());
  EXPECT_EQ(calls, 1);
}

TEST(StopSignalTest, ACallbackThatComesLateRunsAtOnce) {
  StopSignal stop;
  stop.Stop();
  bool called = false;
  stop.SetCallback([&called] { called = true; });
  EXPECT_TRUE(called);
}

// So that a second interrupt ends a program whose way of ending hangs.
TEST(StopSignalTest, ACallbackThatIsAtWorkHoldsNobodyUp) {
  StopSignal stop;
  absl::Notification working, go_on;
  stop.SetCallback([&] {
    working.Notify();
    go_on.WaitForNotification();
  });
  std::thread first([&stop] { EXPECT_TRUE(stop.Stop()); });
  working.WaitForNotification();
  EXPECT_FALSE(stop.Stop());
  EXPECT_TRUE(stop.stopped());
  go_on.Notify();
  first.join();
}

TEST(TerminationWatcherTest, AnInterruptStopsInsteadOfKilling) {
  StopSignal stop;
  absl::Notification stopped;
  stop.SetCallback([&stopped] { stopped.Notify(); });
  const TerminationWatcher watcher(stop);
  kill(getpid(), SIGINT);
  stopped.WaitForNotification();
  EXPECT_TRUE(stop.stopped());
}

// Stands still until it is moved, and knows how often it was asked: once for each signal.
class AskedClock final : public Clock {
 public:
  absl::Time WallNow() const override { return absl::UnixEpoch(); }
  SteadyTime SteadyNow() const override {
    const absl::MutexLock lock(&mutex_);
    ++asked_;
    return now_;
  }
  void Advance(absl::Duration duration) {
    const absl::MutexLock lock(&mutex_);
    now_ += absl::ToChronoNanoseconds(duration);
  }
  void AwaitAsked(int count) const {
    const auto reached = [this, count]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return asked_ >= count; };
    const absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(&reached));
  }

 private:
  mutable absl::Mutex mutex_;
  mutable int asked_ ABSL_GUARDED_BY(mutex_) = 0;
  SteadyTime now_ ABSL_GUARDED_BY(mutex_);
};

struct SignalAfter {
  absl::Duration pause;
  int number = 0;
};

// Receives 'first', then the others, each that long after the one before, until a signal ends the process.
[[noreturn]] void Receive(int first, const std::vector<SignalAfter>& others) {
  StopSignal stop;
  AskedClock clock;
  stop.SetCallback([] {});
  const TerminationWatcher watcher(stop, clock);
  kill(getpid(), first);
  int received = 0;
  for (const SignalAfter& next : others) {
    clock.AwaitAsked(++received);
    clock.Advance(next.pause);
    kill(getpid(), next.number);
  }
  absl::Notification().WaitForNotification();
  std::abort();
}

[[noreturn]] void ReceiveTwice(int first, int second) { Receive(first, {{kSameRequest, second}}); }

// 'soon' comes with the first one.
[[noreturn]] void ReceiveThrice(int first, int soon, int later) {
  Receive(first, {{kSameRequest / 2, soon}, {kSameRequest / 2, later}});
}

[[noreturn]] void ReceiveWithoutListener(int signal) {
  StopSignal stop;
  const TerminationWatcher watcher(stop);
  kill(getpid(), signal);
  absl::Notification().WaitForNotification();
  std::abort();
}

TEST(TerminationWatcherTest, ASecondInterruptEndsTheProcess) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(ReceiveTwice(SIGINT, SIGINT), ::testing::ExitedWithCode(130), "");
  EXPECT_EXIT(ReceiveTwice(SIGINT, SIGTERM), ::testing::ExitedWithCode(143), "");
}

TEST(TerminationWatcherTest, OneThatComesAtOnceAsksForTheSame) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(ReceiveThrice(SIGTERM, SIGTERM, SIGINT), ::testing::ExitedWithCode(130), "");
  EXPECT_EXIT(ReceiveThrice(SIGINT, SIGINT, SIGTERM), ::testing::ExitedWithCode(143), "");
}

TEST(TerminationWatcherTest, AnInterruptThatNobodyListensToEndsTheProcess) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(ReceiveWithoutListener(SIGINT), ::testing::ExitedWithCode(130), "");
  EXPECT_EXIT(ReceiveWithoutListener(SIGTERM), ::testing::ExitedWithCode(143), "");
}

TEST(TerminationWatcherTest, WhereOneHasGoneAwayTheNextOneGetsTheSignals) {
  StopSignal early, late;
  absl::Notification stopped;
  early.SetCallback([] {});
  late.SetCallback([&stopped] { stopped.Notify(); });
  { const TerminationWatcher watcher(early); }
  const TerminationWatcher watcher(late);
  kill(getpid(), SIGTERM);
  stopped.WaitForNotification();
  EXPECT_EQ(late.signal(), SIGTERM);
  EXPECT_FALSE(early.stopped());
}

// As those of libraries, which start threads before main.
TEST(TerminationWatcherTest, AThreadThatWasThereBeforePassesSignalsOn) {
  absl::Notification running;
  const int over = eventfd(0, EFD_CLOEXEC);
  std::thread early([&running, over] {
    sigset_t set;
    sigfillset(&set);
    pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
    running.Notify();
    pollfd end = {over, POLLIN, 0};
    while (poll(&end, 1, -1) < 0) {
    }
  });
  running.WaitForNotification();
  StopSignal stop;
  absl::Notification stopped;
  stop.SetCallback([&stopped] { stopped.Notify(); });
  const TerminationWatcher watcher(stop);
  pthread_kill(early.native_handle(), SIGTERM);
  stopped.WaitForNotification();
  EXPECT_EQ(stop.signal(), SIGTERM);
  eventfd_write(over, 1);
  early.join();
  close(over);
}

}  // namespace
}  // namespace holdfast
