// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/streams/served_streams.h"
#include "server/unread_service.h"

namespace holdfast {

// The gRPC service: its streams are those of ServedStreams. Messages of Track come as bytes: see message_codec.h.
// Thread-safe.
class TrackService final : public UnreadService {
 public:
  // 'streams' must outlive the service.
  explicit TrackService(ServedStreams& streams);

 private:
  Reactor* Track(grpc::CallbackServerContext* context);
  Reactor* GetServerInfo(const grpc::CallbackServerContext& context);

  ServedStreams& streams_;
};

}  // namespace holdfast
