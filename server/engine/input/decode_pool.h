// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"

namespace holdfast {

// A few threads that sessions share by time, not by turns: ten sessions whose every picture takes a second must not
// make a session with small pictures wait for ten seconds between two of them.
// - The next job is that of the session that will have used the least time after it, if it takes as long as the
//   session's last one. Who takes less than a fair share of a busy pool is served first, and waits for at most the job
//   that is running. A session without a finished job is expected to be as slow as the slowest, so only its own first
//   job may wait for a round of the others.
// - The last free thread of several is kept for sessions that come before all those that are being served, so that who
//   takes less than a fair share need not wait at all.
// A session that was idle keeps a lead of at most kCredit; a new one has no lead, otherwise reconnecting would pay.
// The queues are bounded by who submits: a session has at most its pending frames here. Destruction drops the jobs not
// begun and waits for the others. Thread-safe.
class DecodePool {
 private:
  struct Line;

 public:
  static constexpr absl::Duration kCredit = absl::Seconds(2);  // more than the slowest legal picture takes

  // The jobs of one session, begun in their order. Destruction drops those not begun. Must not outlive the pool.
  class Queue {
   public:
    Queue(DecodePool& pool, std::shared_ptr<Line> line) : pool_(pool), line_(std::move(line)) {}
    ~Queue() { pool_.Remove(line_); }
    void Submit(std::function<void()> job) { pool_.Submit(*line_, std::move(job)); }

   private:
    DecodePool& pool_;
    const std::shared_ptr<Line> line_;
  };

  // 'clock' must outlive the pool.
  DecodePool(int threads, const Clock& clock);
  ~DecodePool();
  std::unique_ptr<Queue> NewQueue() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Job = std::function<void()>;
  struct Line {
    std::deque<Job> jobs;
    absl::Duration used;                 // by the jobs that are done, plus what an idle time has cost of the lead
    std::optional<absl::Duration> last;  // what the newest finished job took
    int running = 0;
    bool removed = false;  // stays until its jobs are done: the others are compared with it
    bool busy() const { return running > 0 || !jobs.empty(); }
  };
  struct Taken {
    std::shared_ptr<Line> line;
    Job job;
  };

  void Submit(Line& line, Job job) ABSL_LOCKS_EXCLUDED(mutex_);
  void Remove(const std::shared_ptr<Line>& line) ABSL_LOCKS_EXCLUDED(mutex_);
  void Run() ABSL_LOCKS_EXCLUDED(mutex_);
  // Blocks until a job may begin; empty: the pool is being destroyed.
  std::optional<Taken> Take() ABSL_LOCKS_EXCLUDED(mutex_);
  void Done(const std::shared_ptr<Line>& line, absl::Duration took) ABSL_LOCKS_EXCLUDED(mutex_);
  std::shared_ptr<Line> NextLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Lines with less come first.
  absl::Duration RankLocked(const Line& line) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool MayBeginLocked(const Line& line) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EraseLocked(const std::shared_ptr<Line>& line) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Clock& clock_;
  const int thread_count_;
  absl::Mutex mutex_;
  absl::CondVar changed_;
  std::vector<std::shared_ptr<Line>> lines_ ABSL_GUARDED_BY(mutex_);  // their members too
  int running_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace holdfast
