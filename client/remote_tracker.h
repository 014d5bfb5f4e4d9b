// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/point_tracker.h"

namespace grpc {
class Channel;
}

namespace holdfast {

// PointTracker on a server, over gRPC. Thread-safe; streams keep the connection alive and may outlive the tracker.
// Each stream has a thread that reads results, so that results flow while a write waits; a write waits while the
// server has no room, which is how a slow server slows its client. Every error names the server's address, and the
// last frame sent where there is one; field violations and overload details are kept (see api/errors.h). Whatever the
// server sent before a session was lost reaches the observer before OnDone.
class RemoteTracker final : public PointTracker {
 public:
  struct Options {
    std::string address;                                // "host:port"
    absl::Duration connect_timeout = absl::Seconds(5);  // for the connection to stand
    absl::Duration answer_timeout = absl::Seconds(30);  // for the server to accept a session, or to answer Info()
    // After so long a silence the peer is asked whether it lives, and after that time without an answer the connection
    // is given up. Together they are how long a dead server goes unnoticed; servers drop clients that ask too often.
    absl::Duration keepalive_time = absl::Seconds(30);
    absl::Duration keepalive_timeout = absl::Seconds(10);
    int max_receive_bytes = 64 << 20;  // of one response: a bound on what a broken server can make a client hold

    absl::Status Validate() const;
  };

  // Blocks until the connection stands. UNAVAILABLE when it does not within the timeout; the reason is in the text.
  static absl::StatusOr<std::unique_ptr<RemoteTracker>> Connect(const Options& options);
  ~RemoteTracker() override;

  // Blocks until the server has accepted or refused the session. A refused session's status comes here and to OnDone.
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override;
  absl::StatusOr<TrackerInfo> Info() override;

 private:
  RemoteTracker(const Options& options, std::shared_ptr<grpc::Channel> channel);

  const Options options_;
  const std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace holdfast
