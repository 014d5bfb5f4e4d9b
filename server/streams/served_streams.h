// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/steady_event.h"
#include "holdfast/v1/point_tracking.pb.h"
#include "server/access/gatekeeper.h"
#include "server/engine/engine.h"
#include "server/events.h"
#include "server/streams/served_stream.h"

namespace holdfast {

// A stream with what carries it.
class LiveStream {
 public:
  virtual ~LiveStream() = default;
  virtual ServedStream& stream() = 0;
};

// What a stream says of who opens it.
struct Caller {
  absl::string_view authorization;  // "Bearer TOKEN"; empty: none
  absl::string_view peer;           // for the log
};

// All open streams, of whatever carrier: admits them, owns them and ends them at a drain. New streams are refused with
// UNAVAILABLE before Serve and after Drain, with RESOURCE_EXHAUSTED while too many are open or the engine has no place
// for a session, and as Gatekeeper has it. A thread of its own destroys what ended and watches the timeouts.
// Thread-safe.
class ServedStreams {
 public:
  struct Options {
    StreamOptions stream;
    int max_streams = 64;                             // open at once, those without a session included
    absl::Duration grace_period = absl::Seconds(20);  // of a drain: for sessions to finish by themselves
    SpanSink* spans = nullptr;                        // outlives the streams; null: traces are not recorded
  };
  // Makes a stream of what it is given. 'max_points': no message of more has to be parsed.
  using Maker = absl::FunctionRef<std::unique_ptr<LiveStream>(ServedStream::Deps, Gatekeeper::Pass, int max_points)>;

  // 'gatekeeper', 'clock' and 'events' must outlive the object.
  ServedStreams(const Options& options, Gatekeeper& gatekeeper, Clock& clock, ServerEvents& events,
                std::shared_ptr<spdlog::logger> log);
  // Blocks until the last stream is gone. REQUIRES: no carrier opens one any more.
  ~ServedStreams();

  // From now on streams are admitted. 'engine' must outlive the streams.
  void Serve(Engine& engine) ABSL_LOCKS_EXCLUDED(mutex_);
  // Refuses new streams and blocks until the last one is gone: running ones are told how long they have, may finish
  // within the grace period, then are ended with UNAVAILABLE after a last checkpoint was sent, and at last cut off.
  void Drain() ABSL_LOCKS_EXCLUDED(mutex_);
  // Cuts off all streams that are open, and blocks until they are gone.
  void Abort() ABSL_LOCKS_EXCLUDED(mutex_);

  // A stream more, owned here until Retire; or why there is none. 'system' names the carrier in traces.
  absl::StatusOr<LiveStream*> Open(const Caller& caller, absl::string_view system, Maker make)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // The carrier has let go of the stream, which is destroyed soon.
  void Retire(LiveStream* stream) ABSL_LOCKS_EXCLUDED(mutex_);

  // What the server runs, for who may know.
  absl::StatusOr<v1::GetServerInfoResponse> Info(const Caller& caller) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // The engine for one more stream.
  absl::StatusOr<Engine*> AdmitLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void KeepHouse() ABSL_LOCKS_EXCLUDED(mutex_);
  void DestroyRetired() ABSL_LOCKS_EXCLUDED(mutex_);
  void CheckStreams() ABSL_LOCKS_EXCLUDED(mutex_);
  void DrainStream(ServedStream& stream, absl::Duration draining_for) const;
  bool FullLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return static_cast<int>(live_.size() - retired_.size()) >= options_.max_streams;
  }
  bool IdleLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return alive_ == 0; }

  const Options options_;
  Gatekeeper& gatekeeper_;
  Clock& clock_;
  ServerEvents& events_;
  const std::shared_ptr<spdlog::logger> log_;

  absl::Mutex mutex_;
  Engine* engine_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::optional<SteadyTime> drain_began_ ABSL_GUARDED_BY(mutex_);
  bool aborting_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  int alive_ ABSL_GUARDED_BY(mutex_) = 0;  // streams not destroyed yet
  absl::flat_hash_map<LiveStream*, std::unique_ptr<LiveStream>> live_ ABSL_GUARDED_BY(mutex_);
  std::vector<LiveStream*> retired_ ABSL_GUARDED_BY(mutex_);  // of live_; their carriers have let go of them
  SteadyEvent work_;                                          // something was retired, or stopping_ was set
  std::thread housekeeper_;
};

}  // namespace holdfast
