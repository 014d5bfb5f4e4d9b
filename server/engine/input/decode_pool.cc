// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/decode_pool.h"

#include <algorithm>
#include <utility>

#include "server/engine/input/long_slices.h"

namespace holdfast {

DecodePool::DecodePool(int threads, const Clock& clock) : clock_(clock), thread_count_(threads) {
  for (int i = 0; i < threads; ++i) {
    threads_.emplace_back([this] {
      RunInLongSlices();
      Run();
    });
  }
}

DecodePool::~DecodePool() {
  {
    absl::MutexLock lock(&mutex_);
    stopped_ = true;
    changed_.SignalAll();
  }
  for (std::thread& thread : threads_) thread.join();
}

std::unique_ptr<DecodePool::Queue> DecodePool::NewQueue() {
  auto line = std::make_shared<Line>();
  absl::MutexLock lock(&mutex_);
  for (const auto& other : lines_) line->used = std::max(line->used, other->used);
  lines_.push_back(line);
  return std::make_unique<Queue>(*this, std::move(line));
}

void DecodePool::Submit(Line& line, Job job) {
  absl::MutexLock lock(&mutex_);
  if (!line.busy()) {
    absl::Duration least = absl::InfiniteDuration();
    for (const auto& other : lines_) {
      if (other->busy()) least = std::min(least, other->used);
    }
    if (least != absl::InfiniteDuration()) line.used = std::max(line.used, least - kCredit);
  }
  line.jobs.push_back(std::move(job));
  changed_.SignalAll();
}

void DecodePool::Remove(const std::shared_ptr<Line>& line) {
  std::deque<Job> dropped;  // destroyed without the lock
  absl::MutexLock lock(&mutex_);
  dropped.swap(line->jobs);
  line->removed = true;
  if (!line->busy()) EraseLocked(line);
}

void DecodePool::EraseLocked(const std::shared_ptr<Line>& line) {
  lines_.erase(std::remove(lines_.begin(), lines_.end(), line), lines_.end());
}

void DecodePool::Run() {
  while (std::optional<Taken> taken = Take()) {
    const SteadyTime begin = clock_.SteadyNow();
    taken->job();
    taken->job = nullptr;
    Done(taken->line, clock_.Since(begin));
  }
}

std::optional<DecodePool::Taken> DecodePool::Take() {
  absl::MutexLock lock(&mutex_);
  std::shared_ptr<Line> line;
  while (!stopped_ && (line = NextLocked()) == nullptr) changed_.Wait(&mutex_);
  if (stopped_) return std::nullopt;
  Taken taken{line, std::move(line->jobs.front())};
  line->jobs.pop_front();
  ++line->running;
  ++running_;
  return taken;
}

void DecodePool::Done(const std::shared_ptr<Line>& line, absl::Duration took) {
  absl::MutexLock lock(&mutex_);
  line->last = std::max(took, absl::ZeroDuration());
  line->used += *line->last;
  --line->running;
  --running_;
  if (line->removed && !line->busy()) EraseLocked(line);
  changed_.SignalAll();
}

absl::Duration DecodePool::RankLocked(const Line& line) const {
  if (line.last) return line.used + *line.last;
  absl::Duration slowest;
  for (const auto& other : lines_) slowest = std::max(slowest, other->last.value_or(absl::ZeroDuration()));
  return line.used + slowest;
}

std::shared_ptr<DecodePool::Line> DecodePool::NextLocked() const {
  std::shared_ptr<Line> next;
  for (const auto& line : lines_) {
    if (line->jobs.empty() || !MayBeginLocked(*line)) continue;
    // What is running has not been added to 'used' yet: a second job of a session comes after the first of others.
    if (next == nullptr ||
        std::make_pair(line->running, RankLocked(*line)) < std::make_pair(next->running, RankLocked(*next))) {
      next = line;
    }
  }
  return next;
}

bool DecodePool::MayBeginLocked(const Line& line) const {
  if (running_ == 0 || running_ < thread_count_ - 1) return true;
  const absl::Duration rank = RankLocked(line);
  for (const auto& other : lines_) {
    if (other->running > 0 && rank >= RankLocked(*other)) return false;
  }
  return true;
}

}  // namespace holdfast
