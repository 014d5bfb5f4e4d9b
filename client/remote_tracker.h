// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/point_tracker.h"
#include "client/backoff.h"
#include "client/credentials.h"

namespace holdfast {

struct RemoteServer;

// PointTracker on one of several servers, over gRPC. Thread-safe; streams keep their connections alive and may outlive
// the tracker. Results flow while a write waits; a write waits while the server has no room, which is how a slow server
// slows its client. Every error names the server's address, and the last frame sent where there is one; field
// violations and overload details are kept (see api/errors.h). Whatever a server sent before it was lost reaches the
// observer.
// A session outlives its server (see Options::resume): the stream keeps what it sent since the newest checkpoint, and
// sends it again to the next server that takes the session over. The observer sees one session in which nothing is
// final twice; it hears of the change by OnReconnecting and OnResumed.
class RemoteTracker final : public PointTracker {
 public:
  struct Options {
    // "host:port", tried in order and in rotation; of a host's addresses the first that answers is taken. Or one URI
    // for several servers, "dns:///host:port" or "ipv4:a:port,b:port": sessions are spread over all of its addresses
    // whose grpc.health.v1 says that they take sessions. Servers behind one URI need the same --checkpoint_keys to
    // resume.
    std::vector<std::string> addresses;
    ClientTls tls;
    std::string token;         // sent with every call, to servers that let in only whom they know; empty: none
    std::string trace_parent;  // sent as "traceparent" (W3C Trace Context): sessions belong to that trace; empty: none
    // For the connection to stand, at each of 'addresses'. One attempt has a third of it, but 2 to 10 seconds.
    absl::Duration connect_timeout = absl::Seconds(20);
    // For a server to accept a session, or to answer Info(); a session that goes on elsewhere has a second more for
    // each 64 KiB of its checkpoint, which goes up first.
    absl::Duration answer_timeout = absl::Seconds(30);

    // Sessions go on when their server is lost; false: they end. Servers that make no checkpoints end them as well.
    bool resume = true;
    // Of messages that a stream keeps for that. PushFrame waits while they are full; a session for which they can never
    // do goes on without, and a warning says how much it would take.
    int64_t buffer_bytes = int64_t{256} << 20;
    int checkpoint_interval_frames = 24;  // asked for where SessionConfig leaves it open
    // How long a session that lost its server may look for one; then it ends with the last error.
    absl::Duration reconnect_timeout = absl::Minutes(2);
    Backoff::Options backoff;  // between attempts

    // After so long a silence the peer is asked whether it lives, and after that time without an answer the connection
    // is given up. Together they are how long a dead server goes unnoticed; servers drop clients that ask too often.
    absl::Duration keepalive_time = absl::Seconds(30);
    absl::Duration keepalive_timeout = absl::Seconds(10);
    int max_receive_bytes = 64 << 20;  // of one response: a bound on what a broken server can make a client hold

    absl::Status Validate() const;
  };

  // Blocks until a connection stands, at the first address that answers; of several, one is waited for that does not
  // answer at once when none of the others does. UNAVAILABLE when none does within its timeout; the reasons are in the
  // text.
  static absl::StatusOr<std::unique_ptr<RemoteTracker>> Connect(const Options& options);
  ~RemoteTracker() override;

  // Blocks until a server has accepted the session, or each that is there has refused it. A refused session's status
  // comes here and to OnDone.
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override;
  absl::StatusOr<TrackerInfo> Info() override;

 private:
  RemoteTracker(const Options& options, std::vector<RemoteServer> servers, size_t first_server);

  const Options options_;
  const std::vector<RemoteServer> servers_;
  const size_t first_server_;  // the one that answered
};

}  // namespace holdfast
