// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/steady_event.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "server/access/gatekeeper.h"
#include "server/engine/engine.h"
#include "server/events.h"
#include "server/track_reactor.h"

namespace holdfast {

// The gRPC service: admits streams, owns their reactors and ends them at a drain. New streams are refused with
// UNAVAILABLE before Serve and after Drain, with RESOURCE_EXHAUSTED while too many are open, and as Gatekeeper has it.
// A thread of its own destroys what ended and watches the timeouts. Messages of Track come as bytes: see
// message_codec.h. Thread-safe.
class TrackService final : public v1::PointTracking::WithRawCallbackMethod_Track<
                               v1::PointTracking::WithCallbackMethod_GetServerInfo<v1::PointTracking::Service>> {
 public:
  struct Options {
    StreamOptions stream;
    int max_streams = 64;                             // open at once, those without a session included
    absl::Duration grace_period = absl::Seconds(20);  // of a drain: for sessions to finish by themselves
    SpanSink* spans = nullptr;                        // outlives the service; null: traces are not recorded
  };
  // 'gatekeeper', 'clock' and 'events' must outlive the service.
  TrackService(const Options& options, Gatekeeper& gatekeeper, Clock& clock, ServerEvents& events,
               std::shared_ptr<spdlog::logger> log);
  // Blocks until the last stream is gone. REQUIRES: the gRPC server is shut down.
  ~TrackService() override;

  // From now on streams are admitted. 'engine' must outlive the service's streams.
  void Serve(Engine& engine) ABSL_LOCKS_EXCLUDED(mutex_);
  // Refuses new streams and blocks until the last one is gone: running ones are told how long they have, may finish
  // within the grace period, then are ended with UNAVAILABLE after a last checkpoint was sent, and at last cut off.
  void Drain() ABSL_LOCKS_EXCLUDED(mutex_);

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Track(grpc::CallbackServerContext* context) override
      ABSL_LOCKS_EXCLUDED(mutex_);
  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context, const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  // The engine for one more stream.
  absl::StatusOr<Engine*> AdmitLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Retire(TrackReactor* reactor) ABSL_LOCKS_EXCLUDED(mutex_);
  void KeepHouse() ABSL_LOCKS_EXCLUDED(mutex_);
  void DestroyRetired() ABSL_LOCKS_EXCLUDED(mutex_);
  void CheckStreams() ABSL_LOCKS_EXCLUDED(mutex_);
  void DrainStream(TrackReactor& stream, absl::Duration draining_for) const;
  bool IdleLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return alive_ == 0; }

  const Options options_;
  Gatekeeper& gatekeeper_;
  Clock& clock_;
  ServerEvents& events_;
  const std::shared_ptr<spdlog::logger> log_;

  absl::Mutex mutex_;
  Engine* engine_ ABSL_GUARDED_BY(mutex_) = nullptr;
  std::optional<SteadyTime> drain_began_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  int alive_ ABSL_GUARDED_BY(mutex_) = 0;  // reactors not destroyed yet
  absl::flat_hash_map<TrackReactor*, std::unique_ptr<TrackReactor>> live_ ABSL_GUARDED_BY(mutex_);
  std::vector<TrackReactor*> retired_ ABSL_GUARDED_BY(mutex_);  // of live_; gRPC has let go of them
  SteadyEvent work_;                                            // something was retired, or stopping_ was set
  std::thread housekeeper_;
};

}  // namespace holdfast
