// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_session.h"

#include <algorithm>
#include <limits>
#include <map>
#include <random>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/errors.h"

namespace holdfast {
namespace {

constexpr absl::Duration kShortestPause = absl::Milliseconds(100);  // before a client comes back
constexpr double kMostJitter = 0.5;  // of the pause: clients that were refused together do not come back together
constexpr absl::Duration kSlowReading = absl::Seconds(1);  // for each answer
constexpr int64_t kMostFramesBeforeGoing = 120;
constexpr size_t kMaxErrors = 16;  // that one client remembers

bool IsRefusal(const absl::Status& status) {
  return absl::IsResourceExhausted(status) && OverloadDetails(status).has_value();
}

}  // namespace

const char* NameOf(LoadKind kind) {
  switch (kind) {
    case LoadKind::kHealthy:
      return "healthy";
    case LoadKind::kSlow:
      return "slow";
    case LoadKind::kCancel:
      return "cancel";
    case LoadKind::kBad:
      return "bad";
  }
  return "";
}

// Notes when frames were sent and when their estimates came.
class LoadObserver final : public TrackObserver {
 public:
  // 'before_reading' is called for every answer.
  LoadObserver(const Clock& clock, const std::vector<PointQuery>& points, std::function<void()> before_reading)
      : clock_(clock), before_reading_(std::move(before_reading)) {
    for (const PointQuery& point : points) final_before_[point.id] = 0;
  }

  void Sent() {
    absl::MutexLock lock(&mutex_);
    sent_.push_back(clock_.SteadyNow());
  }

  void OnTracks(TrackUpdate update) override {
    before_reading_();
    const SteadyTime now = clock_.SteadyNow();
    absl::MutexLock lock(&mutex_);
    processed_ = std::max(processed_, update.frames_processed);
    int64_t estimated = 0;
    for (const PointRun& run : update.runs) {
      estimated = std::max(estimated, run.first_frame + static_cast<int64_t>(run.x.size()));
      if (run.final_count == 0) continue;
      final_samples_ += run.final_count;
      int64_t& before = final_before_[run.id];
      before = std::max(before, run.first_frame + run.final_count);
    }
    NoteLocked(estimated, now, first_);
    NoteLocked(FinalBeforeLocked(), now, final_);
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}

  // REQUIRES: the session is over.
  void AddTo(LoadResult& result) {
    absl::MutexLock lock(&mutex_);
    result.frames += processed_;
    result.final_samples += final_samples_;
    result.first.Add(first_.latencies);
    result.final.Add(final_.latencies);
  }

 private:
  struct Noted {
    int64_t frames = 0;
    Latencies latencies;
  };
  void NoteLocked(int64_t before, SteadyTime now, Noted& noted) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    before = std::min(before, static_cast<int64_t>(sent_.size()));
    for (; noted.frames < before; ++noted.frames) noted.latencies.Add(Between(sent_[noted.frames], now));
  }
  int64_t FinalBeforeLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    int64_t before = std::numeric_limits<int64_t>::max();
    for (const auto& [id, frame] : final_before_) before = std::min(before, frame);
    return before;
  }

  const Clock& clock_;
  const std::function<void()> before_reading_;
  absl::Mutex mutex_;
  std::vector<SteadyTime> sent_ ABSL_GUARDED_BY(mutex_);
  std::map<PointId, int64_t> final_before_ ABSL_GUARDED_BY(mutex_);
  int64_t processed_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t final_samples_ ABSL_GUARDED_BY(mutex_) = 0;
  Noted first_ ABSL_GUARDED_BY(mutex_);
  Noted final_ ABSL_GUARDED_BY(mutex_);
};

LoadResult LoadSession::Run() {
  LoadResult result;
  result.kind = options_.kind;
  end_ = clock_.SteadyNow() + absl::ToChronoNanoseconds(options_.duration);
  const auto tracker = connect_();
  if (!tracker.ok()) {
    result.errors.push_back(tracker.status());
    return result;
  }
  if (options_.delay > absl::ZeroDuration() && !Pause(options_.delay)) return result;
  while (!TimeIsOver() && result.errors.size() < kMaxErrors && RunSession(**tracker, result)) {
  }
  return result;
}

bool LoadSession::RunSession(PointTracker& tracker, LoadResult& result) {
  LoadObserver observer(clock_, options_.config.points, [this] {
    if (options_.kind == LoadKind::kSlow) Pause(kSlowReading);
  });
  const SteadyTime begin = clock_.SteadyNow();
  auto stream = tracker.Open(options_.config, observer);
  if (!stream.ok()) {
    if (IsRefusal(stream.status())) {
      ++result.refused;
      result.refusal.Add(clock_.Since(begin));
    } else {
      result.errors.push_back(stream.status());
    }
    const auto overload = OverloadDetails(stream.status());
    const absl::Duration pause = std::max(overload ? overload->retry_after : absl::ZeroDuration(), kShortestPause);
    return Pause(pause * std::uniform_real_distribution<double>(1, 1 + kMostJitter)(random_));
  }
  ++result.sessions;
  ++opened_;
  SetStream(stream->get());
  absl::Status status = Send(**stream, observer);
  SetStream(nullptr);
  stream->reset();
  result.active += clock_.Since(begin);
  observer.AddTo(result);
  if (IsStopped() && absl::IsCancelled(status)) status = absl::OkStatus();
  const bool expected = status.ok() || (options_.kind == LoadKind::kBad && absl::IsInvalidArgument(status));
  if (!expected) result.errors.push_back(status);
  return !IsStopped();
}

void LoadSession::SetStream(TrackStream* stream) {
  absl::MutexLock lock(&mutex_);
  stream_ = stream;
  if (stopped_ && stream_ != nullptr) stream_->Cancel();
}

void LoadSession::Stop() {
  absl::MutexLock lock(&mutex_);
  stopped_ = true;
  if (stream_ != nullptr) stream_->Cancel();
}

bool LoadSession::Pause(absl::Duration duration) const {
  return wait_(std::min(end_, clock_.SteadyNow() + absl::ToChronoNanoseconds(duration)));
}

int64_t LoadSession::FramesToSend() {
  if (options_.kind == LoadKind::kHealthy || options_.kind == LoadKind::kSlow) {
    return std::numeric_limits<int64_t>::max();
  }
  std::mt19937_64 random(options_.seed * 7919 + opened_);
  return static_cast<int64_t>(random() % kMostFramesBeforeGoing) + 1;
}

absl::Status LoadSession::Send(TrackStream& stream, LoadObserver& observer) {
  const std::vector<std::string>& frames = *options_.frames;
  const int64_t count = FramesToSend();
  const SteadyTime begin = clock_.SteadyNow();
  absl::Status status;
  int64_t index = 0;
  for (; index < count && !TimeIsOver() && status.ok() && !IsStopped(); ++index) {
    if (options_.fps > 0) {
      const absl::Duration due = absl::Seconds(static_cast<double>(index) / options_.fps);
      if (!wait_(std::min(end_, begin + absl::ToChronoNanoseconds(due))) || TimeIsOver()) break;
    }
    observer.Sent();
    status = stream.PushFrame({index, frames[static_cast<size_t>(index) % frames.size()], {}, {}});
  }
  if (!status.ok()) return status;
  if (options_.kind == LoadKind::kBad) status = stream.PushFrame({index, "this is no frame", {}, {}});
  if (options_.kind == LoadKind::kCancel || (status.ok() && !TimeIsOver() && IsStopped())) {
    stream.Cancel();  // a run that is stopped waits for nothing more
    return absl::OkStatus();
  }
  return status.ok() ? stream.Finish() : status;
}

}  // namespace holdfast
