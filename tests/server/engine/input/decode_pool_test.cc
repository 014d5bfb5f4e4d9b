// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/decode_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;

constexpr absl::Duration kSlow = absl::Seconds(1), kQuick = absl::Milliseconds(5);

using Queues = std::vector<std::unique_ptr<DecodePool::Queue>>;

Queues NewQueues(DecodePool& pool, int count) {
  Queues queues;
  for (int i = 0; i < count; ++i) queues.push_back(pool.NewQueue());
  return queues;
}

// Keeps a pool's thread busy until it is destroyed, so that what is submitted meanwhile is there at once.
class Plug {
 public:
  explicit Plug(DecodePool& pool) : queue_(pool.NewQueue()) {
    queue_->Submit([this] {
      begun_.Notify();
      end_.WaitForNotification();
    });
    begun_.WaitForNotification();
  }
  void Pull() { end_.Notify(); }

 private:
  std::unique_ptr<DecodePool::Queue> queue_;
  absl::Notification begun_, end_;
};

// Moved by hand, and counts how often it is read: a pool reads it before and after each job.
class CountingClock final : public Clock {
 public:
  absl::Time WallNow() const override { return absl::UnixEpoch(); }
  SteadyTime SteadyNow() const override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    ++reads_;
    changed_.SignalAll();
    return now_;
  }
  void Advance(absl::Duration duration) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    now_ += absl::ToChronoNanoseconds(duration);
  }
  void AwaitReads(int count) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (reads_ < count) changed_.Wait(&mutex_);
  }

 private:
  mutable absl::Mutex mutex_;
  mutable absl::CondVar changed_;
  mutable int reads_ ABSL_GUARDED_BY(mutex_) = 0;
  SteadyTime now_ ABSL_GUARDED_BY(mutex_);
};

class DecodePoolTest : public ::testing::Test {
 protected:
  std::function<void()> Takes(absl::Duration time) {
    return [this, time] { clock_.Advance(time); };
  }
  CountingClock clock_;
};

TEST_F(DecodePoolTest, RunsTheJobsOfASessionInTheirOrder) {
  std::vector<int> order;
  absl::Notification done;
  DecodePool pool(1, clock_);
  const auto queue = pool.NewQueue();
  for (int i = 0; i < 4; ++i) queue->Submit([&order, i] { order.push_back(i); });
  queue->Submit([&done] { done.Notify(); });
  done.WaitForNotification();
  EXPECT_THAT(order, ElementsAre(0, 1, 2, 3));
}

// Ten sessions that always have slow jobs waiting, and a healthy one whose next frame comes when a slow job has begun.
TEST_F(DecodePoolTest, AHealthySessionWaitsOnlyForTheJobThatIsRunning) {
  constexpr size_t kFrames = 50;
  std::vector<int> waits;  // slow jobs begun between a frame's coming and its turn; of the pool's one thread
  bool waiting = false;
  int begun = 0;
  absl::Notification done;
  std::function<void(DecodePool::Queue&)> slow;  // outlives the pool, whose last jobs call it
  DecodePool pool(1, clock_);
  Plug plug(pool);
  const Queues hostile = NewQueues(pool, 10);
  const auto healthy = pool.NewQueue();
  const auto frame = [&] {
    clock_.Advance(kQuick);
    waits.push_back(begun);
    waiting = false;
    if (waits.size() == kFrames) done.Notify();
  };
  slow = [&](DecodePool::Queue& queue) {
    if (waits.size() >= kFrames) return;
    ++begun;
    if (!waiting) {
      waiting = true;
      begun = 0;
      healthy->Submit(frame);
    }
    clock_.Advance(kSlow);
    queue.Submit([&] { slow(queue); });
  };
  for (const auto& queue : hostile) {
    for (int pending = 0; pending < 8; ++pending) queue->Submit([&slow, &queue = *queue] { slow(queue); });
  }
  plug.Pull();
  done.WaitForNotification();
  EXPECT_LE(waits[0], 9) << "nobody has used any time yet: all are equal";
  EXPECT_THAT(std::vector<int>(waits.begin() + 1, waits.end()), Each(0));
}

TEST_F(DecodePoolTest, TheLastThreadIsKeptForWhoHasUsedLessTime) {
  absl::Notification began, release, quick_done, others_done;
  bool second_began = false;
  DecodePool pool(2, clock_);
  const auto healthy = pool.NewQueue(), first = pool.NewQueue(), second = pool.NewQueue();
  // One after the other, so that nobody is charged for what another takes.
  healthy->Submit(Takes(kQuick));
  clock_.AwaitReads(2);
  first->Submit(Takes(kSlow));
  clock_.AwaitReads(4);
  second->Submit(Takes(kSlow));
  clock_.AwaitReads(6);
  first->Submit([&] {
    began.Notify();
    release.WaitForNotification();
  });
  began.WaitForNotification();
  second->Submit([&] {
    second_began = true;
    others_done.Notify();
  });
  for (int i = 0; i < 20; ++i) healthy->Submit(Takes(kQuick));
  healthy->Submit([&] {
    EXPECT_FALSE(second_began);
    quick_done.Notify();
  });
  quick_done.WaitForNotification();
  release.Notify();
  others_done.WaitForNotification();
}

// Ten sessions come at once beside one that is known to be quick: none of their first jobs has priority over it.
TEST_F(DecodePoolTest, SlowFirstJobsDoNotDelayAQuickSessionByARound) {
  std::vector<std::string> order;
  absl::Notification known, done;
  DecodePool pool(1, clock_);
  const auto quick = pool.NewQueue();
  quick->Submit(Takes(kQuick));
  quick->Submit([&] { known.Notify(); });
  known.WaitForNotification();
  const Queues newcomers = NewQueues(pool, 10);
  Plug plug(pool);
  for (const auto& queue : newcomers) {
    queue->Submit([&] {
      order.push_back("slow");
      clock_.Advance(kSlow);
      if (order.size() > 1) return;
      for (int i = 0; i < 3; ++i) {
        quick->Submit([&] {
          order.push_back("quick");
          clock_.Advance(kQuick);
        });
      }
      quick->Submit([&] {
        EXPECT_THAT(order, ElementsAre("slow", "quick", "quick", "quick"));  // here: slow jobs go on being added
        done.Notify();
      });
    });
  }
  plug.Pull();
  done.WaitForNotification();
}

TEST_F(DecodePoolTest, ANewSessionHasNoLead) {
  std::vector<std::string> order;
  absl::Notification used, done;
  DecodePool pool(1, clock_);
  const auto frugal = pool.NewQueue(), greedy = pool.NewQueue();
  greedy->Submit(Takes(kSlow));
  greedy->Submit([&] { used.Notify(); });
  used.WaitForNotification();
  Plug plug(pool);
  const auto newcomer = pool.NewQueue();
  newcomer->Submit([&] { order.push_back("newcomer"); });
  frugal->Submit([&] { order.push_back("frugal"); });
  newcomer->Submit([&] { done.Notify(); });
  plug.Pull();
  done.WaitForNotification();
  EXPECT_THAT(order, ElementsAre("frugal", "newcomer"));
}

TEST_F(DecodePoolTest, ALongIdleTimeSavesUpNoMoreThanTheCredit) {
  std::vector<std::string> order;
  absl::Notification used, done;
  DecodePool pool(1, clock_);
  const auto idle = pool.NewQueue(), busy = pool.NewQueue();
  busy->Submit(Takes(absl::Hours(1)));
  busy->Submit([&] { used.Notify(); });
  used.WaitForNotification();
  Plug plug(pool);
  busy->Submit([&] { order.push_back("busy"); });
  for (int i = 0; i < 4; ++i) {
    idle->Submit([&] {
      order.push_back("idle");
      clock_.Advance(DecodePool::kCredit * 0.3);
    });
  }
  idle->Submit([&] { done.Notify(); });
  plug.Pull();
  done.WaitForNotification();
  EXPECT_THAT(order, ElementsAre("idle", "idle", "idle", "busy", "idle"));
}

TEST_F(DecodePoolTest, DropsTheJobsOfASessionThatIsGone) {
  bool ran = false;
  absl::Notification done;
  DecodePool pool(1, clock_);
  Plug plug(pool);
  auto gone = pool.NewQueue();
  const auto other = pool.NewQueue();
  gone->Submit([&] { ran = true; });
  gone.reset();
  other->Submit([&] { done.Notify(); });
  plug.Pull();
  done.WaitForNotification();
  EXPECT_FALSE(ran);
}

TEST_F(DecodePoolTest, ASessionMayGoWhileItsJobRuns) {
  absl::Notification began, release, done;
  DecodePool pool(1, clock_);
  auto gone = pool.NewQueue();
  gone->Submit([&] {
    began.Notify();
    release.WaitForNotification();
  });
  began.WaitForNotification();
  gone.reset();
  release.Notify();
  const auto other = pool.NewQueue();
  other->Submit([&] { done.Notify(); });
  done.WaitForNotification();
}

}  // namespace
}  // namespace holdfast
