// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/point_tracker.h"
#include "api/types.h"
#include "client/cli/latencies.h"

namespace holdfast {

// How one of many clients behaves.
enum class LoadKind {
  kHealthy,  // sends frames, reads results, finishes
  kSlow,     // takes its time over each of its results
  kCancel,   // goes away in the middle, and comes back
  kBad,      // sends what is no frame, and comes back
};
const char* NameOf(LoadKind kind);

// What one client has seen.
struct LoadResult {
  LoadKind kind = LoadKind::kHealthy;
  int64_t sessions = 0;  // that were accepted
  int64_t refused = 0;   // for overload
  int64_t frames = 0;    // whose features were computed
  int64_t final_samples = 0;
  absl::Duration active;             // while it had a session
  Latencies first;                   // from a frame sent to its first estimate
  Latencies final;                   // and to the final estimate of every point
  Latencies refusal;                 // from a session wanted to it refused
  std::vector<absl::Status> errors;  // that such a client should not see
  double FramesPerSecond() const { return active > absl::ZeroDuration() ? frames / absl::ToDoubleSeconds(active) : 0; }
};

// One client: frames that are shown over and over, for a limited time.
class LoadSession {
 public:
  struct Options {
    LoadKind kind = LoadKind::kHealthy;
    SessionConfig config;
    std::shared_ptr<const std::vector<std::string>> frames;  // encoded as the config says; not empty
    double fps = 0;                                          // 0: as fast as the server takes them
    absl::Duration duration;
    uint64_t seed = 0;     // of when it goes away, and comes back
    absl::Duration delay;  // before the first session; part of the duration
  };
  using Connect = std::function<absl::StatusOr<std::unique_ptr<PointTracker>>()>;
  // Waits until then, or less when the run is stopped, and says whether to go on.
  using Wait = std::function<bool(SteadyTime until)>;

  LoadSession(const Options& options, Connect connect, const Clock& clock, Wait wait)
      : options_(options), connect_(std::move(connect)), clock_(clock), wait_(std::move(wait)), random_(options.seed) {}

  // Blocks for the duration and until the last session is over.
  LoadResult Run();
  // From any thread: the session in progress waits for nothing more. 'wait' has to tell of it before.
  void Stop() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // One session; false: it makes no sense to open another.
  bool RunSession(PointTracker& tracker, LoadResult& result);
  absl::Status Send(TrackStream& stream, class LoadObserver& observer);
  // At most to the end of the time; false: the run is stopped.
  bool Pause(absl::Duration duration) const;
  // 'stream' is what Stop cancels; null: nothing.
  void SetStream(TrackStream* stream) ABSL_LOCKS_EXCLUDED(mutex_);
  bool IsStopped() const { return !Pause(absl::ZeroDuration()); }
  bool TimeIsOver() const { return clock_.SteadyNow() >= end_; }
  // Frames that a client that goes away sends before.
  int64_t FramesToSend();

  const Options options_;
  const Connect connect_;
  const Clock& clock_;
  const Wait wait_;
  std::mt19937_64 random_;
  SteadyTime end_;
  uint64_t opened_ = 0;
  absl::Mutex mutex_;
  TrackStream* stream_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace holdfast
